"""Depth and attitude as constraints on frames: single wrong readings rejected, gaps left without a constraint."""

from dataclasses import dataclass

import numpy as np

from asfm.config import BackendConfig
from asfm.diagnostics import Diagnostic, format_runs, frame_runs
from asfm.geometry.poses import depth_roll_pitch, interpolate
from asfm.navigation.outlier_filter import find_outliers
from asfm.sequence import Sequence
from asfm.types import BoolArray, FloatArray, Navigation, Trajectory

LONGEST_GAP_S = 1.0
GAP_INTERVALS = 3.0
"""Readings are interpolated over a second or this many of their median intervals, whichever is longer."""
CHANNELS = ("depth", "roll", "pitch")
UNITS = ((1.0, "m"), (180 / np.pi, "deg"), (180 / np.pi, "deg"))


@dataclass(frozen=True)
class DepthAttitude:
    """What navigation says of each frame's height, roll and pitch."""

    z_roll_pitch: FloatArray
    """(N, 3) metres and radians, finite; (0, 3) without navigation."""
    sigma: FloatArray
    """(N, 3) standard deviations; infinite where no reading is near."""
    diagnostics: tuple[Diagnostic, ...] = ()


def interpolate_depth_attitude(
    sequence: Sequence, config: BackendConfig, odometry: Trajectory | None = None
) -> DepthAttitude:
    """Interpolate depth and attitude at the frames' stamps.

    A reading that stands alone against the running median of its neighbours is left out. So are frames in a gap of
    the readings or outside their time. Where readings are rarer than frames, several frames share what one reading
    knows: their sigmas are widened by the root of their number.

    Args:
        odometry: what is taken off the readings before they are compared with each other, so that a vehicle that
            really moves is not taken for a wrong reading.
    """
    navigation = sequence.navigation
    if navigation is None or not config.use_navigation or not len(navigation.timestamps_s):
        return DepthAttitude(np.zeros((0, 3)), np.zeros((0, 3)))
    readings = stack_readings(navigation)
    sigma = _sensor_sigma(sequence)
    level = _detrend(readings, navigation, odometry)
    wrong, away = find_outliers(level, sigma + _odometry_sigma(sequence, odometry), navigation.timestamps_s)
    values, widened = np.empty((len(sequence), 3)), np.empty((len(sequence), 3))
    for channel in range(3):
        good = ~wrong[:, channel]
        stamps_s = navigation.timestamps_s[good]
        values[:, channel] = np.interp(sequence.timestamps_s, stamps_s, readings[good, channel])
        sharing = frames_per_reading(stamps_s, sequence.timestamps_s, navigation.timestamps_s)
        widened[:, channel] = sigma[channel] * np.sqrt(sharing)
    far = ~np.isfinite(frames_per_reading(navigation.timestamps_s, sequence.timestamps_s))
    return DepthAttitude(values, widened, (*_diagnose_outliers(wrong, away, sigma), *_diagnose_gaps(far)))


def stack_readings(navigation: Navigation) -> FloatArray:
    """Give the readings as (R, 3) z_m, roll_rad, pitch_rad; the roll runs on beyond half a turn."""
    return np.stack([navigation.z_m, np.unwrap(navigation.roll_rad), navigation.pitch_rad], axis=1)


def frames_per_reading(stamps_s: FloatArray, at_s: FloatArray, all_s: FloatArray | None = None) -> FloatArray:
    """Count how many stamps share the knowledge of one reading: (M,), at least 1; infinite where none is near.

    Args:
        stamps_s: (R,) stamps of the readings, rising.
        at_s: (M,) stamps that ask, rising.
        all_s: stamps of the readings before any was left out: what their usual interval follows from.
    """
    if not len(stamps_s):
        return np.full(len(at_s), np.inf)
    usual = stamps_s if all_s is None else all_s
    interval_s = float(np.median(np.diff(usual))) if len(usual) > 1 else LONGEST_GAP_S
    asked_s = float(np.median(np.diff(at_s))) if len(at_s) > 1 else interval_s
    after = np.clip(np.searchsorted(stamps_s, at_s), 1, max(len(stamps_s) - 1, 1))
    before_s, after_s = stamps_s[after - 1], stamps_s[np.minimum(after, len(stamps_s) - 1)]
    apart_s = np.minimum(np.abs(at_s - before_s), np.abs(after_s - at_s))
    inside = (at_s >= before_s) & (at_s <= after_s)
    bridged = inside & (after_s - before_s <= max(LONGEST_GAP_S, GAP_INTERVALS * interval_s))
    beside = apart_s <= 0.5 * max(interval_s, asked_s) + 1e-9
    share = np.where(bridged, np.maximum((after_s - before_s) / max(asked_s, 1e-12), 1.0), 1.0)
    return np.asarray(np.where(bridged | beside, np.where(apart_s <= 1e-9, np.minimum(share, 1.0), share), np.inf))


def _sensor_sigma(sequence: Sequence) -> FloatArray:
    noise = sequence.noise
    return np.array([noise.navigation_z_m, noise.navigation_roll_rad, noise.navigation_pitch_rad])


def _odometry_sigma(sequence: Sequence, odometry: Trajectory | None) -> FloatArray:
    if odometry is None:
        return np.zeros(3)
    noise = sequence.noise
    return np.array([noise.odometry_translation_m, noise.odometry_rotation_rad, noise.odometry_rotation_rad])


def _detrend(readings: FloatArray, navigation: Navigation, odometry: Trajectory | None) -> FloatArray:
    """Take the odometry's height and tilt off the readings: what is left wanders slowly."""
    if odometry is None:
        return readings
    level = depth_roll_pitch(interpolate(odometry.timestamps_s, odometry.world_from_vehicle, navigation.timestamps_s))
    return readings - level


def _diagnose_outliers(wrong: BoolArray, away: FloatArray, sigma: FloatArray) -> list[Diagnostic]:
    found = []
    for channel, (name, (scale, unit)) in enumerate(zip(CHANNELS, UNITS, strict=True)):
        count = int(wrong[:, channel].sum())
        if count:
            worst = scale * float(away[wrong[:, channel], channel].max())
            message = (
                f"navigation: {count} of {len(wrong)} {name} readings differ from their neighbours by up to "
                f"{worst:.3g} {unit}, where the stated sigma is {scale * float(sigma[channel]):.2g} {unit}: rejected"
            )
            found.append(Diagnostic("navigation-outliers", message))
    return found


def _diagnose_gaps(far: BoolArray) -> list[Diagnostic]:
    if not far.any():
        return []
    runs = frame_runs(far)
    message = (
        f"navigation: no reading near {int(far.sum())} of {len(far)} frames ({format_runs(runs)}): depth and attitude "
        "do not constrain them"
    )
    return [Diagnostic("navigation-gap", message, runs)]
