"""Feature noise: standard deviations of the range and bearing at which a detector places a feature."""

from functools import lru_cache

import numpy as np

from asfm.config import NoiseConfig
from asfm.geometry.sonar import SonarModel
from asfm.types import FloatArray, Tracks


@lru_cache(maxsize=8)
def feature_sigma(sonar: SonarModel, noise: NoiseConfig) -> FloatArray:
    """Return the default standard deviations (2,) of a feature's range_m and bearing_rad. Read-only."""
    bearing_rad = max(noise.bearing_beams * sonar.bearing_step_rad, np.deg2rad(noise.min_bearing_deg))
    return _read_only(np.array([noise.range_bins * sonar.range_step_m, bearing_rad]))


@lru_cache(maxsize=8)
def difference_sigma(sonar: SonarModel, noise: NoiseConfig) -> FloatArray:
    """Return the standard deviations (2,) of the difference of two features' range_m and bearing_rad. Read-only."""
    return _read_only(np.asarray(feature_sigma(sonar, noise) * np.sqrt(2.0)))


def relative_position_noise_m(range_m: FloatArray, sonar: SonarModel, noise: NoiseConfig) -> FloatArray:
    """Return two standard deviations (M,) of the distance that noise moves matched keypoints at (M,) ranges apart."""
    sigma = difference_sigma(sonar, noise)
    return np.asarray(2.0 * np.hypot(sigma[0], sigma[1] * range_m))


def observation_sigma(tracks: Tracks, sonar: SonarModel, noise: NoiseConfig) -> FloatArray:
    """Return the (O, 2) standard deviations that tracks state, or the default ones where they state none."""
    if tracks.sigma is not None:
        return tracks.sigma
    return np.tile(feature_sigma(sonar, noise), (len(tracks), 1))


def gate_sigma(tracks: Tracks, sonar: SonarModel, noise: NoiseConfig) -> FloatArray:
    """Return the (O, 2) standard deviations for gating observations: those stated, but at least the default ones."""
    return np.maximum(observation_sigma(tracks, sonar, noise), feature_sigma(sonar, noise))


def _read_only(values: FloatArray) -> FloatArray:
    values.flags.writeable = False
    return values
