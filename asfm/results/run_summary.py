"""Summary of a run: the reconstruction, its diagnostics, its evaluation and the cost of each stage."""

from dataclasses import dataclass, field
from pathlib import Path

from asfm.config import NoiseConfig
from asfm.diagnostics import Diagnostic
from asfm.evaluation.evaluation_table import EvaluationTable
from asfm.sequence import Sequence
from asfm.stages import StageReport
from asfm.types import Reconstruction


@dataclass(frozen=True)
class RunSummary:
    """The outcome of one run of a sequence."""

    folder: Path
    """Results folder."""
    source: Path
    """Folder or file of the sequence."""
    sequence: Sequence
    reconstruction: Reconstruction
    stages: tuple[StageReport, ...]
    diagnostics: tuple[Diagnostic, ...]
    """Those of the sequence, of the reconstruction and of the evaluation."""
    evaluation: EvaluationTable | None
    """None where the sequence has nothing to compare with."""
    wall_s: float
    """From opening the sequence until all results but the report were written."""
    external_matches: tuple[Path, Path] | None = None
    """Files of keypoints and matches that replaced asfm's own."""
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    """Of the features, as the gates used it."""
