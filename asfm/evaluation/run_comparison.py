"""Comparison of runs: matcher quality and pose errors of several results side by side."""

from dataclasses import dataclass

from asfm.evaluation.accuracy_bound import BOUND_ATE
from asfm.evaluation.evaluation_table import EvaluationRow, EvaluationTable
from asfm.evaluation.mirror_image import ATE_RMSE_MIRRORED
from asfm.evaluation.pose_error_table import ATE_RMSE


@dataclass(frozen=True)
class RunLabels:
    """What a run is called in the comparison."""

    run: str
    """Name of the results folder, unique in the comparison."""
    sequence: str
    """Name of the sequence, with the frames where not all are used; unique to the sequence in the comparison."""
    matcher: str
    """Detector, or file of external keypoints, and filters."""


@dataclass(frozen=True)
class ComparedRun:
    """One run of a comparison; what is unknown is None."""

    labels: RunLabels
    seconds: float | None
    """Wall time of the run."""
    precision: float | None = None
    """Over all frame pairs, as the next three."""
    recall: float | None = None
    arc_inlier_ratio: float | None = None
    matches: int | None = None
    ate_m: float | None = None
    """RMSE, SE(3)-aligned, scale off; where the run is ambiguous, of itself or its mirror image, whichever is less."""
    mirror_ambiguous: bool = False
    """The run does not tell itself from its mirror image."""
    ate_over_odometry: float | None = None
    ate_over_bound: float | None = None
    nees_position: float | None = None
    """Per degree of freedom; of the run itself, as the next one."""
    nees_attitude: float | None = None


@dataclass(frozen=True)
class RunComparison:
    """Several runs side by side."""

    runs: tuple[ComparedRun, ...]
    notes: tuple[str, ...] = ()
    """Limits of the comparison, one sentence each."""


def compare_run(labels: RunLabels, seconds: float | None, table: EvaluationTable | None) -> ComparedRun:
    """Pick the measures of one run from its evaluation; without one they are all unknown."""
    rows = {row.key: row for row in table.rows} if table is not None else {}

    def value(key: str) -> float | None:
        return rows[key].value if key in rows else None

    matches = value("match_count_overall")
    ate_m = _nearer(rows)
    odometry_m = rows[ATE_RMSE].odometry if ATE_RMSE in rows and rows[ATE_RMSE].ratio is not None else None
    return ComparedRun(
        labels,
        seconds,
        precision=value("match_precision_overall"),
        recall=value("match_recall_overall"),
        arc_inlier_ratio=value("match_arc_inlier_ratio_overall"),
        matches=None if matches is None else round(matches),
        ate_m=ate_m,
        mirror_ambiguous=ATE_RMSE_MIRRORED in rows,
        ate_over_odometry=_divide(ate_m, odometry_m),
        ate_over_bound=_divide(ate_m, value(BOUND_ATE)),
        nees_position=value("nees_position"),
        nees_attitude=value("nees_attitude"),
    )


def note_differences(runs: tuple[ComparedRun, ...]) -> tuple[str, ...]:
    """Return notes on what is not alike in the runs: their sequences, and the choice between mirror images."""
    notes = []
    sequences = list(dict.fromkeys(run.labels.sequence for run in runs))
    if len(sequences) > 1:
        notes.append(
            f"The runs are of {len(sequences)} different sequences ({', '.join(sequences)}): "
            "matches and ATE of different sequences are not comparable, the ratios are to some degree."
        )
    if any(run.mirror_ambiguous for run in runs):
        notes.append(
            "* ATE of the run or of its mirror image, whichever is less: the sonar alone cannot tell them apart."
        )
    return tuple(notes)


def _nearer(rows: dict[str, EvaluationRow]) -> float | None:
    """Return the smaller ATE of the run and, where that is evaluated, of its mirror image."""
    return min((rows[key].value for key in (ATE_RMSE, ATE_RMSE_MIRRORED) if key in rows), default=None)


def _divide(value: float | None, by: float | None) -> float | None:
    return value / by if value is not None and by is not None and by > 0 else None
