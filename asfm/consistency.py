"""Consistency of a result with its measurements: residuals over stated noise, and scores of the calibration."""

from dataclasses import dataclass
from typing import Any

from asfm.diagnostics import FrameRuns


@dataclass(frozen=True)
class ResidualStatistics:
    """Residuals of one kind of measurement in units of their stated standard deviation."""

    sensor: str
    mean_square: float
    """Chi-square per degree of freedom over all frames: 1 or less where the stated noise is right."""
    worst_mean_square: float
    """The same over the worst stretch of frames."""
    worst_sum: float
    """Largest sum over a stretch, over the root of its number of values: residuals of one sign make it large."""
    worst_frames: tuple[int, int]
    """First and last frame of the stretch with the largest mean square."""
    inconsistent: FrameRuns = ()
    """Frames where the measurements contradict the result."""


@dataclass(frozen=True)
class CalibrationScore:
    """Error of one calibration parameter by a score test, all others held at what the recording states."""

    parameter: str
    value: float
    """Estimated error, in metres, radians, seconds or as a ratio: what is stated minus what would fit best."""
    sigma: float
    """Standard deviation of that estimate."""
    inconsistent: bool = False
    """Whether the error is larger than noise and ordinary tolerances explain."""


@dataclass(frozen=True)
class LocalFit:
    """Residuals of a solution beside those of short windows of frames fitted alone."""

    ratio: float = 1.0
    """Typical residual of the whole solution over that of the windows; 1 where no window tells."""
    lost_share: float = 0.0
    """Share of the observations that are outliers of the whole solution, less the same in the windows."""
    poor: bool = False
    """Whether the solution fits its observations much worse than short stretches of it do."""
    poor_frames: FrameRuns = ()
    """Frames of the windows that the solution fits much worse."""


@dataclass(frozen=True)
class Consistency:
    """How well a result agrees with what it was made from."""

    residuals: tuple[ResidualStatistics, ...] = ()
    calibration: tuple[CalibrationScore, ...] = ()
    used_share: float = 1.0
    """Observations that agree with the result, of those that tracks hold and a track may have."""

    local_fit: LocalFit | None = None
    """Without odometry: the fit of the whole beside that of short windows of frames."""

    def as_dict(self) -> dict[str, Any]:
        """Return what report.json holds of it."""
        residuals = {item.sensor: {k: v for k, v in vars(item).items() if k != "sensor"} for item in self.residuals}
        scores = {
            item.parameter: {k: v for k, v in vars(item).items() if k != "parameter"} for item in self.calibration
        }
        local = vars(self.local_fit).copy() if self.local_fit else None
        return {"residuals": residuals, "calibration": scores, "used_share": self.used_share, "local_fit": local}
