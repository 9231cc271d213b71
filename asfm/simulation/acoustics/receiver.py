"""The receiver: how pulse and beams smear an echo, and the noise that is laid over it."""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from asfm.geometry.sonar import SonarModel
from asfm.simulation.acoustics.correlated_fields import FieldBank, draw_mix, mix_energies
from asfm.simulation.sonars.parameters import ImagingSonar
from asfm.types import FloatArray, ImageArray

FWHM_PER_SIGMA = 2.354820045
BAND_ROWS = 100
"""So many rows get their noise at once: their numbers stay in the processor's cache."""
LONE_PRODUCT = 1 << 18
"""Multiplications up to which OpenBLAS works on the calling thread; a frame must not wake others."""
SPECKLED = np.float32(0.002)
"""Image value, half a count of eight bits, below which speckle cannot be seen."""


@dataclass(frozen=True)
class PointSpread:
    """What the receiver makes of a point."""

    pulse: ImageArray
    """(2 k + 1,) weights over the rows, of sum 1."""
    lobe: ImageArray
    """(2 m + 1, beams) share that an echo in each beam leaves in the beams m before to m after it; columns of sum 1."""
    share: ImageArray
    """(beams, beams) the same as a matrix: the share that beam i has of an echo in beam j."""
    side_lobes: tuple[tuple[int, float], ...]
    """(half-width in beams, power a beam) of the boxes whose sum is the envelope of the side lobes."""
    cross_talk: float
    """Power that every beam takes from the mean over all beams at the same range."""


def make_point_spread(sonar: ImagingSonar, model: SonarModel) -> PointSpread:
    """Work out the smear from pulse length, beam width, side lobes and cross-talk."""
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
    """Gaussian in the sine of the bearing, which is what a line array resolves."""
    sine = np.sin(bearing_rad)
    reach = max(1, int(np.ceil(1.3 * width_rad / np.diff(sine).min())))
    near = np.pad(sine, reach, constant_values=np.inf)
    away = np.stack([near[shift : shift + len(sine)] for shift in range(2 * reach + 1)]) - sine
    lobe = np.exp(-4 * np.log(2) * (away / width_rad) ** 2)
    return np.asarray(lobe / lobe.sum(axis=0))


def _lobe_matrix(lobe: ImageArray) -> ImageArray:
    reach, beams = len(lobe) // 2, lobe.shape[1]
    padded = np.zeros((beams + 2 * reach, beams), dtype=np.float32)
    for shift, weight in enumerate(lobe):
        padded[np.arange(beams) + shift, np.arange(beams)] = weight
    return padded[reach : reach + beams]


def _side_lobes(level_db: float, width_beams: float, beams: int) -> tuple[tuple[int, float], ...]:
    """Stack boxes, an octave apart, into an envelope that falls by 6 dB an octave from the first side lobe on."""
    level = 10 ** (level_db / 10) / max(1.06 * width_beams, 1.0)  # relative to the peak of a lobe of sum 1
    half, boxes = max(2, round(2 * width_beams)), []
    while half < beams:
        boxes.append((half, float(0.75 * level)))
        half, level = 2 * half, level / 4
    return tuple(boxes)


def spread_ranges(power: ImageArray, spread: PointSpread) -> ImageArray:
    """Smear a (beams, ranges) image of power along ranges by the pulse."""
    import cv2

    alone = np.ones(1, dtype=np.float32)
    return np.asarray(cv2.sepFilter2D(power, -1, spread.pulse, alone, borderType=cv2.BORDER_CONSTANT), dtype=np.float32)


def spread_beams(power: ImageArray, spread: PointSpread, some: slice = slice(None)) -> ImageArray:
    """Smear a (beams, ranges) image of power along beams by the main lobe; give ``some`` of the beams."""
    first, last, _ = some.indices(len(power))
    reach = len(spread.lobe) // 2
    near = slice(max(first - reach, 0), last + reach)
    share = spread.share[first:last, near]
    smeared = np.empty((last - first, power.shape[1]), dtype=np.float32)
    width = max(1, LONE_PRODUCT // share.size)
    for row in range(0, power.shape[1], width):
        np.matmul(share, power[near, row : row + width], out=smeared[:, row : row + width])
    return smeared


def sum_beams(power: ImageArray, spread: PointSpread) -> ImageArray:
    """Sum a (beams, ranges) image of power over the beams before each, padded as far as the side lobes reach."""
    reach, beams = _reach(spread), len(power)
    total = np.zeros((beams + 2 * reach + 1, power.shape[1]), dtype=np.float32)
    for beam in range(beams):  # three times as fast as a cumulative sum, which adds one number at a time
        np.add(total[reach + beam], power[beam], out=total[reach + beam + 1])
    total[reach + beams + 1 :] = total[reach + beams]
    return total


def leak_beams(total: ImageArray, spread: PointSpread, some: slice = slice(None)) -> ImageArray:
    """Give what leaks into ``some`` beams by side lobes and cross-talk, from the sums of :func:`sum_beams`."""
    reach = _reach(spread)
    beams = len(total) - 2 * reach - 1
    first, last, _ = some.indices(beams)
    leaked: ImageArray = np.tile(total[-1] * np.float32(spread.cross_talk / beams), (last - first, 1))
    box = np.empty_like(leaked)
    for half, level in spread.side_lobes:
        low, high = reach - half, reach + half + 1
        np.subtract(total[high + first : high + last], total[low + first : low + last], out=box)
        box *= np.float32(level)
        leaked += box
    return leaked


def _reach(spread: PointSpread) -> int:
    return max((half for half, _ in spread.side_lobes), default=0)


def add_noise(
    clean: ImageArray,
    sonar: ImagingSonar,
    model: SonarModel,
    rng: np.random.Generator,
    bank: FieldBank | None = None,
) -> ImageArray:
    """Lay speckle and background over a clean image, and take off the receiver's threshold.

    The background is Rayleigh, the amplitude of complex Gaussian noise. Without a bank of fields all pixels are
    independent; with one, beams that overlap hear alike.
    """
    image = clean.copy()
    sigma = background_sigma(sonar, model)
    if bank is None:
        energies = rng.standard_exponential((2, *clean.shape), dtype=np.float32)
    else:
        mix = draw_mix(bank, len(clean), rng)
    for first in range(0, len(clean), BAND_ROWS):
        rows = slice(first, first + BAND_ROWS)
        speckle, background = energies[:, rows] if bank is None else mix_energies(bank, mix, rows)
        _disturb(image[rows], speckle, background, sigma[rows], sonar)
    return image


def _disturb(
    image: ImageArray, speckle: ImageArray, background: ImageArray, sigma: ImageArray, sonar: ImagingSonar
) -> None:
    """Lay speckle and background of the given energies over some rows of an image, in place."""
    if sonar.mult_sigma:
        seen = np.flatnonzero(image > SPECKLED)  # a third of the image, as a rule
        image.ravel()[seen] *= shape_speckle(speckle.ravel()[seen], sonar.mult_sigma)
    if sonar.add_sigma or sonar.near_sigma:
        noise = background * (2 * sigma**2)
        image += np.sqrt(noise, out=noise)
    if sonar.threshold:
        image -= np.float32(sonar.threshold)
    np.clip(image, 0, 1, out=image)


def shape_speckle(energy: ImageArray, contrast: float) -> ImageArray:
    """Turn exponential energies into Weibull amplitudes of mean 1 and the stated standard deviation.

    Weibull amplitudes hold fully developed speckle as the case of contrast 0.523 (Rayleigh), less where several looks
    or facets add up, more where few strong scatterers share a pixel.
    """
    power = _speckle_power(contrast)
    return np.asarray(energy ** np.float32(power) * np.float32(1 / math.gamma(1 + power)))


@cache
def _speckle_power(contrast: float) -> float:
    """Find p such that the p-th power of an exponential variate has the stated contrast; it grows with p."""
    low, high = 0.0, 1.0
    for _ in range(60):
        power = 0.5 * (low + high)
        if math.sqrt(math.gamma(1 + 2 * power) / math.gamma(1 + power) ** 2 - 1) < contrast:
            low = power
        else:
            high = power
    return power


def background_sigma(sonar: ImagingSonar, model: SonarModel) -> ImageArray:
    """Give the background's Rayleigh scale: (ranges, 1), or (ranges, beams) with reverberation.

    Reverberation comes from the water that the transmitter lights, so that it falls with range and off the axis.
    """
    receiver = sonar.add_sigma * (model.range_m[:, None] / sonar.range_max) ** sonar.noise_range_exponent
    if not sonar.near_sigma:
        return np.asarray(receiver, dtype=np.float32)
    nearest_m = max(sonar.range_min, model.range_step_m)
    water = sonar.near_sigma * (nearest_m / np.maximum(model.range_m[:, None], nearest_m)) ** sonar.near_exponent
    off_axis = model.bearing_rad / np.abs(model.bearing_rad).max()
    pattern = 10 ** (sonar.azimuth_edge_db * off_axis**2 / 10)
    return np.asarray(np.sqrt(receiver**2 + water**2 * pattern), dtype=np.float32)
