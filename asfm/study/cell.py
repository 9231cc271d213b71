"""Cell of a study: one reconstruction, with everything that it depends on."""

from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from asfm.config import Config
from asfm.study.fingerprint import hash_content, hash_software
from asfm.study.study_definition import Mode

FRONTEND_SECTIONS = ("cfar", "clusters", "keypoints", "matching", "ssl", "localisation", "noise", "frames")
"""Sections of the configuration that features and matches depend on."""


@dataclass(frozen=True)
class Recording:
    """A sequence that exists."""

    name: str
    path: Path
    content: str
    """Fingerprint of its files."""

    def describe(self, seed: int) -> dict[str, Any]:
        """Return what the images depend on; the seed changes nothing of them."""
        del seed
        return {"content": self.content}


@dataclass(frozen=True)
class Simulation:
    """A sequence to be simulated."""

    scene: str
    sonar: str
    motion: str | None
    scene_seed: int
    frames: int
    sonar_content: str = ""
    """Fingerprint of the sonar's file, if it has one."""
    scene_content: str = ""
    """Fingerprint of the mesh, if the scene is one."""

    @property
    def name(self) -> str:
        """Scene, sonar, motion and seed of the scene, as far as they differ from the usual ones."""
        parts = [Path(self.scene).stem, Path(self.sonar).stem]
        parts += [self.motion] if self.motion else []
        return "-".join([*parts, *([f"scene{self.scene_seed}"] if self.scene_seed else [])])

    def describe(self, seed: int) -> dict[str, Any]:
        """Return what the images and sensors of a seed depend on."""
        return {"simulation": asdict(self), "seed": seed}


@dataclass(frozen=True)
class External:
    """An external matcher."""

    name: str
    content: str
    """Fingerprint of its files or of its module."""
    features: Path | None = None
    matches: Path | None = None
    function: str | None = None
    learned: bool = False
    """Whether the name is that of a matcher of :mod:`asfm.learned`."""


@dataclass(frozen=True)
class Corruption:
    """One setting of every dial of the controlled corruption; see CorruptionSettings."""

    wrong_share: float
    wrong_kind: str
    range_noise_bins: float
    bearing_noise_beams: float
    noise_kind: str
    recall: float
    track_length: int | None
    points: int


@dataclass(frozen=True)
class Cell:
    """One reconstruction."""

    sequence: Recording | Simulation
    seed: int
    mode: Mode
    matcher: str
    """Name of the detector or of the external matcher, or "true matches"."""
    filters: str
    """Name of the filter chain."""
    backend: str
    """Name of the changes of the configuration."""
    config: Config
    """Every setting, those of the cell's axes included."""
    bound_draws: int
    external: External | None = None
    corruption: Corruption | None = None

    @cached_property
    def id(self) -> str:
        """Fingerprint of everything that the result depends on."""
        return hash_content(
            {
                "software": hash_software(),
                "sequence": self.sequence.describe(self.seed),
                "config": self.config.model_dump(mode="json"),
                "mode": self.mode,
                "bound_draws": self.bound_draws,
                "external": self.external and [self.external.name, self.external.content],
                "corruption": self.corruption and asdict(self.corruption),
                "labels": [self.sequence.name, self.seed, self.matcher, self.filters, self.backend],
            }
        )

    @cached_property
    def sequence_key(self) -> str:
        """Fingerprint of the images and sensors."""
        return hash_content({"software": hash_software(), "sequence": self.sequence.describe(self.seed)})

    @cached_property
    def features_key(self) -> str:
        """Fingerprint of the features; cells that differ in mode, filters and back-end alone share it."""
        sections = self.config.model_dump(mode="json", include=set(FRONTEND_SECTIONS))
        del sections["matching"]["filters"]
        return hash_content({"sequence": self.sequence_key, "sections": sections})

    @property
    def label(self) -> str:
        """Sequence, matcher, filters, back-end, mode and seed for messages."""
        return f"{self.sequence.name}, {self.matcher}, {self.filters}, {self.backend}, {self.mode}, seed {self.seed}"
