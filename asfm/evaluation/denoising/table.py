"""The denoising table: several methods on several frames with truth, their means, and where masking loses."""

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
"""Field, name, unit and digits."""


@dataclass(frozen=True)
class DenoisedFrame:
    """How well one method denoised one frame."""

    scene: str
    """Name of the scene, or of the sequence."""
    sonar: str
    frame: int
    method: str
    quality: DenoisingQuality
    wall_ms: float

    @property
    def key(self) -> tuple[str, str, int]:
        """What all methods' rows of one frame share."""
        return self.scene, self.sonar, self.frame


@dataclass(frozen=True)
class DenoisingTable:
    """All methods on all frames."""

    rows: tuple[DenoisedFrame, ...]
    notes: tuple[str, ...] = ()
    """What was left out, one clear sentence each."""

    @property
    def methods(self) -> tuple[str, ...]:
        """In the order of their first row."""
        return tuple(dict.fromkeys(row.method for row in self.rows))

    def names(self, group: str) -> tuple[str, ...]:
        """Give all scenes, or all sonars, in the order of their first row."""
        return tuple(dict.fromkeys(getattr(row, group) for row in self.rows))

    def average(self, method: str, **group: str) -> DenoisingQuality:
        """Average a method over all frames, or over those of one ``scene`` or ``sonar``; every frame weighs alike."""
        return average_denoising([row.quality for row in self.pick(method, **group)])

    def wall_ms(self, method: str) -> float:
        """Average the time that a method took for a frame."""
        return float(np.mean([row.wall_ms for row in self.pick(method)]))

    def as_dict(self) -> dict[str, Any]:
        """Turn the table into what JSON holds: means, means by scene and by sonar, every frame, and the words."""
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
        """Give the rows of a method, or those of one ``scene`` or ``sonar``."""
        wanted = {"method": method, **group}
        return (row for row in self.rows if all(getattr(row, key) == value for key, value in wanted.items()))


@dataclass(frozen=True)
class Comparison:
    """One frame denoised by all methods."""

    images: dict[str, ImageArray]
    """By method."""
    qualities: dict[str, DenoisingQuality]
    wall_ms: dict[str, float]

    def rows(self, scene: str, sonar: str, frame: int) -> list[DenoisedFrame]:
        """Give the rows of the table that this comparison makes."""
        return [
            DenoisedFrame(scene, sonar, frame, method, quality, self.wall_ms[method])
            for method, quality in self.qualities.items()
        ]


def compare_denoisers(
    frame: Frame, truth: FrameTruth, config: Config, denoisers: Mapping[str, Denoiser] = DENOISERS
) -> Comparison:
    """Denoise one frame by every method and compare each result with the image without noise.

    The support is where the truth has an elevation. Pixels without data count as right for all methods.

    Raises:
        AsfmError: frame and truth differ in shape, or are smaller than the window of SSIM.
    """
    shape = frame.image.shape
    if min(shape) < SSIM_WINDOW_PX or truth.clean.shape != shape:
        raise AsfmError(
            f"expected images of at least {SSIM_WINDOW_PX} x {SSIM_WINDOW_PX} pixels, which SSIM needs, and the truth "
            f"of the same shape; found {shape} and {truth.clean.shape}"
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
    """Say in words by which measure, and in which scenes and for which sonars, masking is worse than another method."""
    sentences = []
    for method in (name for name in (MASK, OURS) if name in table.methods):
        found = [_describe_loss(table, method, measure) for measure in MEASURES]
        lost = [sentence for sentence in found if sentence]
        sentences += lost or [f"{method} loses by no measure, in no scene and for no sonar"]
    return tuple(sentences)


def _describe_loss(table: DenoisingTable, method: str, measure: tuple[str, str, str, int]) -> str:
    """Give one sentence on one measure, or nothing where the method is the best everywhere."""
    field, name, unit, digits = measure
    overall = _compare_with_others(table, method, field)
    parts = []
    if overall is not None:
        own, best, value = overall
        raw = getattr(table.average(RAW), field) if RAW in table.methods and best != RAW else None
        beside = "" if raw is None else f"; raw {raw:.{digits}f}{unit}"
        parts.append(f"{own:.{digits}f} against {value:.{digits}f}{unit} of {best}{beside}")
    for group in ("scene", "sonar"):
        names = table.names(group)
        places = []
        for place in names if len(names) > 1 else ():
            lost = _compare_with_others(table, method, field, **{group: place})
            if lost is not None:
                places.append(f"{place} ({lost[0]:.{digits}f} against {lost[2]:.{digits}f} of {lost[1]})")
        if places:
            parts.append(f"every {group}" if len(places) == len(names) else ", ".join(places))
    frames = _count_lost_frames(table, method, field)
    if frames:
        parts.append(f"{frames} of {len(tuple(table.pick(method)))} frames")
    return f"{method} loses in {name}: {'; '.join(parts)}" if parts else ""


def _count_lost_frames(table: DenoisingTable, method: str, field: str) -> int:
    """Count the frames in which another method is better."""
    best: dict[tuple[str, str, int], float] = {}
    for row in table.rows:
        value = getattr(row.quality, field)
        if row.method not in (method, MASK, OURS) and value is not None:
            best[row.key] = max(value, best.get(row.key, value))
    own = {row.key: getattr(row.quality, field) for row in table.pick(method)}
    return sum(value is not None and value < best.get(key, value) for key, value in own.items())


def _compare_with_others(
    table: DenoisingTable, method: str, field: str, **group: str
) -> tuple[float, str, float] | None:
    """Give a method's value with the best other method and its value where that is better, else None."""
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
