"""The receiver: how pulse and beams smear an echo, and the noise that is laid over it."""

from dataclasses import dataclass

import numpy as np

from asfm.simulation.sensor import ImagingSonar
from asfm.sonar import SonarModel
from asfm.types import FloatArray, ImageArray

FWHM_PER_SIGMA = 2.354820045


@dataclass(frozen=True)
class PointSpread:
    """What the receiver makes of a point."""

    pulse: ImageArray
    """(2 k + 1,) weights over the rows, of sum 1."""
    beams: ImageArray
    """(beams, beams) power that an echo in one beam (row) leaves in every beam (column); rows of sum 1."""


def make_point_spread(sonar: ImagingSonar, model: SonarModel) -> PointSpread:
    """Work out the smear from pulse length, beam width, side lobes and cross-talk."""
    sigma_rows = (sonar.pulse_length_m or 1.5 * model.range_step_m) / model.range_step_m / FWHM_PER_SIGMA
    reach = max(1, int(np.ceil(3 * sigma_rows)))
    pulse = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma_rows) ** 2)
    return PointSpread((pulse / pulse.sum()).astype(np.float32), _beam_matrix(sonar, model).astype(np.float32))


def _beam_matrix(sonar: ImagingSonar, model: SonarModel) -> FloatArray:
    """Gaussian main lobe, side lobes that fall by 6 dB an octave below it, a floor of cross-talk."""
    width = np.deg2rad(sonar.beam_width_deg) if sonar.beam_width_deg else model.bearing_step_rad
    away = np.abs(np.sin(model.bearing_rad[:, None]) - np.sin(model.bearing_rad))
    width_s = width * np.cos(model.bearing_rad)[:, None]  # a line array resolves sines of bearing
    lobes = np.exp(-4 * np.log(2) * (away / width_s) ** 2)
    first_lobe = 1.5 * width_s
    envelope = 10 ** (sonar.side_lobe_db / 10) * (first_lobe / np.maximum(away, first_lobe)) ** 2
    matrix = np.maximum(lobes, np.where(away > 0.5 * width_s, envelope, 0))
    matrix += 10 ** (sonar.cross_talk_db / 10)
    return np.asarray(matrix / matrix.sum(axis=1, keepdims=True))


def spread_power(power: ImageArray, spread: PointSpread) -> ImageArray:
    """Smear a (ranges, beams) image of power along ranges and beams."""
    reach = len(spread.pulse) // 2
    padded = np.pad(power @ spread.beams, ((reach, reach), (0, 0)))
    rows = len(power)
    smeared: ImageArray = spread.pulse[0] * padded[:rows]
    for tap, weight in enumerate(spread.pulse[1:], start=1):
        smeared += weight * padded[tap : tap + rows]
    return smeared


def add_noise(clean: ImageArray, sonar: ImagingSonar, model: SonarModel, rng: np.random.Generator) -> ImageArray:
    """Lay speckle and background over a clean image.

    Speckle is a gamma variate of mean 1 and standard deviation ``mult_sigma`` a pixel; the background is Rayleigh of
    scale ``add_sigma``, the amplitude of complex Gaussian noise, drawn as the root of an exponential variate.
    """
    image = clean.copy()
    if sonar.mult_sigma:
        shape = np.float32(1 / sonar.mult_sigma**2)
        image *= rng.standard_gamma(shape, clean.shape, dtype=np.float32) / shape
    if sonar.add_sigma:
        scale = sonar.add_sigma * (model.range_m / sonar.range_max) ** sonar.noise_range_exponent
        energy = rng.standard_exponential(clean.shape, dtype=np.float32)
        image += np.sqrt(2 * energy) * scale.astype(np.float32)[:, None]
    return np.clip(image, 0, 1, out=image)
