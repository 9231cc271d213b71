"""Receiver model: point spread of pulse and beams, side lobes and cross-talk."""

from dataclasses import dataclass

import numpy as np

from asfm.geometry.sonar import SonarModel
from asfm.simulation.sonars.parameters import ImagingSonar
from asfm.types import FloatArray, ImageArray

FWHM_PER_SIGMA = 2.354820045
MAX_SINGLE_THREAD_PRODUCTS = 1 << 18
"""Multiplications up to which OpenBLAS stays on the calling thread; frames are rendered in parallel already."""


@dataclass(frozen=True)
class PointSpread:
    """Point spread function of the receiver, separable into ranges and beams."""

    pulse: ImageArray
    """(2 k + 1,) weights over the rows; their sum is 1."""
    lobe: ImageArray
    """(2 m + 1, beams) share of an echo's power in the beams m before to m after its own; columns sum to 1."""
    lobe_matrix: ImageArray
    """(beams, beams) the same as a matrix: share in beam i of an echo in beam j."""
    side_lobes: tuple[tuple[int, float], ...]
    """(half-width in beams, power per beam) of the box filters whose sum is the envelope of the side lobes."""
    cross_talk: float
    """Share of the mean power over all beams at the same range that leaks into every beam."""


def make_point_spread(sonar: ImagingSonar, model: SonarModel) -> PointSpread:
    """Compute the point spread from pulse length, beam width, side lobes and cross-talk."""
    sigma_rows = (sonar.pulse_length_m or model.range_step_m) / model.range_step_m / FWHM_PER_SIGMA
    reach = max(1, int(np.ceil(3 * sigma_rows)))
    pulse = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma_rows) ** 2)
    width = np.deg2rad(sonar.beam_width_deg) if sonar.beam_width_deg else model.bearing_step_rad
    lobe = _main_lobe(model.bearing_rad, width).astype(np.float32)
    return PointSpread(
        (pulse / pulse.sum()).astype(np.float32),
        lobe,
        _lobe_matrix(lobe),
        _side_lobes(sonar.side_lobe_db, width / model.bearing_step_rad, len(model.bearing_rad)),
        10 ** (sonar.cross_talk_db / 10),
    )


def _main_lobe(bearing_rad: FloatArray, width_rad: float) -> FloatArray:
    """Return the main lobe, (2 m + 1, beams): Gaussian in the sine of the bearing, as for a line array."""
    sine = np.sin(bearing_rad)
    reach = max(1, int(np.ceil(1.3 * width_rad / np.diff(sine).min())))
    near = np.pad(sine, reach, constant_values=np.inf)
    away = np.stack([near[shift : shift + len(sine)] for shift in range(2 * reach + 1)]) - sine
    lobe = np.exp(-4 * np.log(2) * (away / width_rad) ** 2)
    return np.asarray(lobe / lobe.sum(axis=0))


def _lobe_matrix(lobe: ImageArray) -> ImageArray:
    """Return the (beams, beams) matrix of a lobe, (2 m + 1, beams)."""
    reach, beams = len(lobe) // 2, lobe.shape[1]
    padded = np.zeros((beams + 2 * reach, beams), dtype=np.float32)
    for shift, weight in enumerate(lobe):
        padded[np.arange(beams) + shift, np.arange(beams)] = weight
    return padded[reach : reach + beams]


def _side_lobes(level_db: float, width_beams: float, beams: int) -> tuple[tuple[int, float], ...]:
    """Return box filters, an octave apart, whose sum falls by 6 dB per octave from the first side lobe on."""
    level = 10 ** (level_db / 10) / max(1.06 * width_beams, 1.0)  # relative to the peak of a lobe of sum 1
    half, boxes = max(2, round(2 * width_beams)), []
    while half < beams:
        boxes.append((half, float(0.75 * level)))
        half, level = 2 * half, level / 4
    return tuple(boxes)


def spread_ranges(power: ImageArray, spread: PointSpread) -> ImageArray:
    """Convolve a (beams, ranges) image of power along ranges with the pulse."""
    import cv2

    identity = np.ones(1, dtype=np.float32)
    return np.asarray(
        cv2.sepFilter2D(power, -1, spread.pulse, identity, borderType=cv2.BORDER_CONSTANT), dtype=np.float32
    )


def spread_beams(power: ImageArray, spread: PointSpread, beams: slice = slice(None)) -> ImageArray:
    """Apply the main lobe to a (beams, ranges) image of power; returns the selected ``beams``."""
    first, last, _ = beams.indices(len(power))
    reach = len(spread.lobe) // 2
    near = slice(max(first - reach, 0), last + reach)
    weights = spread.lobe_matrix[first:last, near]
    received = np.empty((last - first, power.shape[1]), dtype=np.float32)
    width = max(1, MAX_SINGLE_THREAD_PRODUCTS // weights.size)
    for row in range(0, power.shape[1], width):
        np.matmul(weights, power[near, row : row + width], out=received[:, row : row + width])
    return received


def sum_beams(power: ImageArray, spread: PointSpread) -> ImageArray:
    """Compute the cumulative sum of a (beams, ranges) image of power over the beams, for box filters.

    Returns:
        (beams + 2 reach + 1, ranges), padded by the half-width of the widest side lobe.
    """
    reach, beams = _side_lobe_reach(spread), len(power)
    total = np.zeros((beams + 2 * reach + 1, power.shape[1]), dtype=np.float32)
    for beam in range(beams):  # three times as fast as np.cumsum
        np.add(total[reach + beam], power[beam], out=total[reach + beam + 1])
    total[reach + beams + 1 :] = total[reach + beams]
    return total


def leak_beams(total: ImageArray, spread: PointSpread, beams: slice = slice(None)) -> ImageArray:
    """Compute the power that leaks into the selected ``beams`` by side lobes and cross-talk.

    Args:
        total: cumulative sums of :func:`sum_beams`.
        spread: the point spread.
        beams: which beams are returned.

    Returns:
        (selected beams, ranges) power.
    """
    reach = _side_lobe_reach(spread)
    beam_count = len(total) - 2 * reach - 1
    first, last, _ = beams.indices(beam_count)
    leaked: ImageArray = np.tile(total[-1] * np.float32(spread.cross_talk / beam_count), (last - first, 1))
    box = np.empty_like(leaked)
    for half, level in spread.side_lobes:
        low, high = reach - half, reach + half + 1
        np.subtract(total[high + first : high + last], total[low + first : low + last], out=box)
        box *= np.float32(level)
        leaked += box
    return leaked


def _side_lobe_reach(spread: PointSpread) -> int:
    """Return the half-width of the widest box filter, in beams."""
    return max((half for half, _ in spread.side_lobes), default=0)
