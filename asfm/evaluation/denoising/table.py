"""Denoising table: quality of several methods on frames with ground truth, averages, and losses of the masked methods.

The masked methods are the echo mask alone and ours; a loss is a measure in which a baseline is better.
"""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from time import perf_counter
from typing import Any

import numpy as np

from asfm.config import Config
from asfm.errors import AsfmError
from asfm.evaluation.denoising.methods import DENOISERS, MASK, OURS, RAW, Denoiser
from asfm.evaluation.denoising.metrics import SSIM_WINDOW_PX, DenoisingQuality, average_denoising, measure_denoising
from asfm.types import Frame, FrameTruth, ImageArray

MEASURES = (
    ("psnr_db", "PSNR", " dB", 2),
    ("ssim", "SSIM", "", 3),
    ("support_psnr_db", "PSNR in the support", " dB", 2),
)
"""Field, printed name, unit and decimals of each measure."""


@dataclass(frozen=True)
class DenoisedFrame:
    """Quality of one method on one frame, a row of the table."""

    scene: str
    """Name of the scene, or of the sequence."""
    sonar: str
    frame: int
    method: str
    quality: DenoisingQuality
    wall_ms: float

    @property
    def key(self) -> tuple[str, str, int]:
        """Scene, sonar and frame number: the same for all methods."""
        return self.scene, self.sonar, self.frame


@dataclass(frozen=True)
class DenoisingTable:
    """Quality of all methods on all frames."""

    rows: tuple[DenoisedFrame, ...]
    notes: tuple[str, ...] = ()
    """Skipped sources and frames, one sentence each."""

    @property
    def methods(self) -> tuple[str, ...]:
        """Names of the methods in the order of their first row."""
        return tuple(dict.fromkeys(row.method for row in self.rows))

    def names(self, group: str) -> tuple[str, ...]:
        """Return the names of a group, ``scene`` or ``sonar``, in the order of their first row."""
        return tuple(dict.fromkeys(getattr(row, group) for row in self.rows))

    def average(self, method: str, **group: str) -> DenoisingQuality:
        """Average the quality of a method over all frames, or over those of one ``scene`` or ``sonar``."""
        return average_denoising([row.quality for row in self.pick(method, **group)])

    def wall_ms(self, method: str) -> float:
        """Average the wall time of a method per frame, in milliseconds."""
        return float(np.mean([row.wall_ms for row in self.pick(method)]))

    def as_dict(self) -> dict[str, Any]:
        """Convert the table to JSON types: averages, averages by scene and by sonar, all frames, losses and notes."""
        return {
            "mean": {name: asdict(self.average(name)) | {"wall_ms": self.wall_ms(name)} for name in self.methods},
            **{f"by_{group}": self._averages_by(group) for group in ("scene", "sonar")},
            "frames": [asdict(row) for row in self.rows],
            "losses": list(list_losses(self)),
            "notes": list(self.notes),
        }

    def _averages_by(self, group: str) -> dict[str, dict[str, Any]]:
        return {
            name: {method: asdict(self.average(method, **{group: name})) for method in self.methods}
            for name in self.names(group)
        }

    def pick(self, method: str, **group: str) -> Iterator[DenoisedFrame]:
        """Select the rows of a method, of all frames or of those of one ``scene`` or ``sonar``."""
        selection = {"method": method, **group}
        return (row for row in self.rows if all(getattr(row, key) == value for key, value in selection.items()))


@dataclass(frozen=True)
class Comparison:
    """One frame denoised by all methods; the dictionaries are keyed by method."""

    images: dict[str, ImageArray]
    """(ranges, beams) in 0..1."""
    qualities: dict[str, DenoisingQuality]
    wall_ms: dict[str, float]

    def rows(self, scene: str, sonar: str, frame: int) -> list[DenoisedFrame]:
        """Convert the comparison to rows of the table."""
        return [
            DenoisedFrame(scene, sonar, frame, method, quality, self.wall_ms[method])
            for method, quality in self.qualities.items()
        ]


def compare_denoisers(
    frame: Frame, truth: FrameTruth, config: Config, denoisers: Mapping[str, Denoiser] = DENOISERS
) -> Comparison:
    """Denoise one frame by every method and compare each result with the noise-free image.

    The support is where the truth has an elevation. Invalid pixels count as correct for all methods.

    Args:
        frame: image (ranges, beams) in 0..1 with its invalid pixels.
        truth: noise-free image and elevation of the frame.
        config: configuration of the methods.
        denoisers: methods by name.

    Returns:
        Images, qualities and wall times by method.

    Raises:
        AsfmError: frame and truth differ in shape, or are smaller than the window of SSIM.
    """
    shape = frame.image.shape
    if min(shape) < SSIM_WINDOW_PX or truth.clean.shape != shape:
        raise AsfmError(
            f"denoising table: expected frame and truth of the same shape, at least {SSIM_WINDOW_PX} x "
            f"{SSIM_WINDOW_PX} pixels for SSIM, found {shape} and {truth.clean.shape}"
        )
    support = np.isfinite(truth.elevation_rad)
    images, qualities, wall_ms = {}, {}, {}
    for name, denoise in denoisers.items():
        start_s = perf_counter()
        images[name] = denoise(frame, config)
        wall_ms[name] = 1e3 * (perf_counter() - start_s)
        compared = np.where(frame.invalid, truth.clean, images[name])
        qualities[name] = measure_denoising(compared, truth.clean, support)
    return Comparison(images, qualities, wall_ms)


def list_losses(table: DenoisingTable) -> tuple[str, ...]:
    """List the measures, scenes and sonars in which a baseline is better than a masked method, one sentence each."""
    sentences = []
    for method in (name for name in (MASK, OURS) if name in table.methods):
        descriptions = [_describe_loss(table, method, measure) for measure in MEASURES]
        losses = [sentence for sentence in descriptions if sentence]
        sentences += losses or [f"{method} loses by no measure, in no scene and for no sonar"]
    return tuple(sentences)


def _describe_loss(table: DenoisingTable, method: str, measure: tuple[str, str, str, int]) -> str:
    """Describe the losses of a method in one measure in a sentence, empty without losses."""
    field, name, unit, digits = measure
    overall = _compare_with_baselines(table, method, field)
    parts = []
    if overall is not None:
        own, best, value = overall
        raw = getattr(table.average(RAW), field) if RAW in table.methods and best != RAW else None
        raw_text = "" if raw is None else f"; raw {raw:.{digits}f}{unit}"
        parts.append(f"{own:.{digits}f} against {value:.{digits}f}{unit} of {best}{raw_text}")
    for group in ("scene", "sonar"):
        names = table.names(group)
        losses = []
        for member in names if len(names) > 1 else ():
            loss = _compare_with_baselines(table, method, field, **{group: member})
            if loss is not None:
                losses.append(f"{member} ({loss[0]:.{digits}f} against {loss[2]:.{digits}f} of {loss[1]})")
        if losses:
            parts.append(f"every {group}" if len(losses) == len(names) else ", ".join(losses))
    frames = _count_lost_frames(table, method, field)
    if frames:
        parts.append(f"{frames} of {len(tuple(table.pick(method)))} frames")
    return f"{method} loses in {name}: {'; '.join(parts)}" if parts else ""


def _count_lost_frames(table: DenoisingTable, method: str, field: str) -> int:
    """Count the frames in which a baseline is better."""
    best: dict[tuple[str, str, int], float] = {}
    for row in table.rows:
        value = getattr(row.quality, field)
        if row.method not in (method, MASK, OURS) and value is not None:
            best[row.key] = max(value, best.get(row.key, value))
    own = {row.key: getattr(row.quality, field) for row in table.pick(method)}
    return sum(value is not None and value < best.get(key, value) for key, value in own.items())


def _compare_with_baselines(
    table: DenoisingTable, method: str, field: str, **group: str
) -> tuple[float, str, float] | None:
    """Return the value of a method, and name and value of the best baseline; None if no baseline is better."""
    own = getattr(table.average(method, **group), field)
    values = {
        other: getattr(table.average(other, **group), field)
        for other in table.methods
        if other not in (method, MASK, OURS)
    }
    known = {other: value for other, value in values.items() if value is not None}
    if own is None or not known:
        return None
    best = max(known, key=lambda other: known[other])
    return (own, best, known[best]) if own < known[best] else None
