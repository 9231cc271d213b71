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
class Consistency:
    """How well a result agrees with what it was made from."""

    residuals: tuple[ResidualStatistics, ...] = ()
    calibration: tuple[CalibrationScore, ...] = ()
    used_share: float = 1.0
    """Observations that agree with the result, of those that tracks hold and a track may have."""

    def as_dict(self) -> dict[str, Any]:
        """Return what report.json holds of it."""
        residuals = {item.sensor: {k: v for k, v in vars(item).items() if k != "sensor"} for item in self.residuals}
        scores = {
            item.parameter: {k: v for k, v in vars(item).items() if k != "parameter"} for item in self.calibration
        }
        return {"residuals": residuals, "calibration": scores, "used_share": self.used_share}
