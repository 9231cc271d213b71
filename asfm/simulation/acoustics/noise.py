"""Noise model: Weibull speckle, Rayleigh background with volume reverberation, and the receiver's threshold."""

import math
from functools import cache

import numpy as np

from asfm.geometry.sonar import SonarModel
from asfm.simulation.acoustics.correlated_fields import FieldBank, draw_mix, mix_energies
from asfm.simulation.sonars.parameters import ImagingSonar
from asfm.types import ImageArray

NOISE_BAND_ROWS = 100
"""Rows that get their noise at once, so few that they stay in the processor's cache."""
MIN_SPECKLED_VALUE = np.float32(0.002)
"""Image value (half a step of 8 bits) below which speckle is not visible and not drawn."""


def add_noise(
    clean: ImageArray,
    sonar: ImagingSonar,
    model: SonarModel,
    rng: np.random.Generator,
    bank: FieldBank | None = None,
) -> ImageArray:
    """Add speckle and background noise to a clean image, and subtract the receiver's threshold.

    The background is Rayleigh, the amplitude of complex Gaussian noise.

    Args:
        clean: (ranges, beams) image in 0..1.
        sonar: parameters of the noise.
        model: the pixel grid.
        rng: source of the noise.
        bank: fields whose correlation between beams follows the beam pattern; without it all pixels are independent.

    Returns:
        (ranges, beams) image in 0..1.
    """
    image = clean.copy()
    sigma = background_sigma(sonar, model)
    if bank is None:
        energies = rng.standard_exponential((2, *clean.shape), dtype=np.float32)
    else:
        mix = draw_mix(bank, len(clean), rng)
    for first in range(0, len(clean), NOISE_BAND_ROWS):
        rows = slice(first, first + NOISE_BAND_ROWS)
        speckle, background = energies[:, rows] if bank is None else mix_energies(bank, mix, rows)
        _apply_noise(image[rows], speckle, background, sigma[rows], sonar)
    return image


def _apply_noise(
    image: ImageArray, speckle: ImageArray, background: ImageArray, sigma: ImageArray, sonar: ImagingSonar
) -> None:
    """Apply speckle and background of the given energies to some rows of an image, in place."""
    if sonar.mult_sigma:
        visible = np.flatnonzero(image > MIN_SPECKLED_VALUE)  # typically a third of the image
        image.ravel()[visible] *= weibull_speckle(speckle.ravel()[visible], sonar.mult_sigma)
    if sonar.add_sigma or sonar.near_sigma:
        noise = background * (2 * sigma**2)
        image += np.sqrt(noise, out=noise)
    if sonar.threshold:
        image -= np.float32(sonar.threshold)
    np.clip(image, 0, 1, out=image)


def weibull_speckle(energy: ImageArray, contrast: float) -> ImageArray:
    """Turn (ranges, beams) exponential energies into Weibull amplitudes of mean 1 and standard deviation ``contrast``.

    Fully developed speckle is the case of contrast 0.523 (Rayleigh). The contrast is lower for several looks or facets
    per pixel, and higher for few strong scatterers.
    """
    power = _speckle_power(contrast)
    return np.asarray(energy ** np.float32(power) * np.float32(1 / math.gamma(1 + power)))


@cache
def _speckle_power(contrast: float) -> float:
    """Find p such that the p-th power of an exponential variate has the given contrast, by bisection."""
    low, high = 0.0, 1.0
    for _ in range(60):
        power = 0.5 * (low + high)
        if math.sqrt(math.gamma(1 + 2 * power) / math.gamma(1 + power) ** 2 - 1) < contrast:
            low = power
        else:
            high = power
    return power


def background_sigma(sonar: ImagingSonar, model: SonarModel) -> ImageArray:
    """Return the Rayleigh scale of the background: (ranges, 1), or (ranges, beams) with reverberation.

    Volume reverberation follows the transmitter's beam pattern, so that it decreases with range and off the axis.
    """
    receiver = sonar.add_sigma * (model.range_m[:, None] / sonar.range_max) ** sonar.noise_range_exponent
    if not sonar.near_sigma:
        return np.asarray(receiver, dtype=np.float32)
    nearest_m = max(sonar.range_min, model.range_step_m)
    reverberation = (
        sonar.near_sigma * (nearest_m / np.maximum(model.range_m[:, None], nearest_m)) ** sonar.near_exponent
    )
    off_axis = model.bearing_rad / np.abs(model.bearing_rad).max()
    pattern = 10 ** (sonar.azimuth_edge_db * off_axis**2 / 10)
    return np.asarray(np.sqrt(receiver**2 + reverberation**2 * pattern), dtype=np.float32)
