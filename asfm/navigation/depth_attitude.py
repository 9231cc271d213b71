"""Depth and attitude readings interpolated at the frame times, with outliers rejected and gaps left unconstrained."""

from dataclasses import dataclass

import numpy as np

from asfm.config import BackendConfig
from asfm.diagnostics import Diagnostic, format_runs, frame_runs
from asfm.geometry.poses import depth_roll_pitch, interpolate
from asfm.geometry.time_gaps import SAME_TIME_S, longest_bridge_s, measure_gaps, median_interval_s
from asfm.navigation.outlier_filter import find_outliers
from asfm.sequence import Sequence
from asfm.types import BoolArray, FloatArray, Navigation, Trajectory

CHANNELS = ("depth", "roll", "pitch")
UNITS = ((1.0, "m"), (180 / np.pi, "deg"), (180 / np.pi, "deg"))
"""Factor from the internal unit of each channel, and the unit that messages state."""


@dataclass(frozen=True)
class DepthAttitude:
    """Measured height, roll and pitch of the vehicle at the frame times."""

    z_roll_pitch: FloatArray
    """(N, 3) metres and radians, finite; (0, 3) without navigation."""
    sigma: FloatArray
    """(N, 3) standard deviations; infinite where no reading is near."""
    diagnostics: tuple[Diagnostic, ...] = ()


def interpolate_depth_attitude(
    sequence: Sequence, config: BackendConfig, odometry: Trajectory | None = None
) -> DepthAttitude:
    """Interpolate depth and attitude at the frame times.

    Outliers are rejected first. Frames in a gap of the readings or outside their time get infinite sigmas. Where
    readings are rarer than frames, several frames share the information of one reading: their sigmas are multiplied by
    the root of their number.

    Args:
        sequence: frame times, readings and their stated noise.
        config: whether navigation is used.
        odometry: world_from_vehicle; subtracted from the readings before outliers are sought, so that a fast motion
            that odometry confirms is not rejected.
    """
    navigation = sequence.navigation
    if navigation is None or not config.use_navigation or not len(navigation.timestamps_s):
        return DepthAttitude(np.zeros((0, 3)), np.zeros((0, 3)))
    readings = stack_readings(navigation)
    sigma = _sensor_sigma(sequence)
    detrended = _detrend(readings, navigation, odometry)
    outlier, deviation = find_outliers(detrended, sigma + _odometry_sigma(sequence, odometry), navigation.timestamps_s)
    values, shared_sigma = np.empty((len(sequence), 3)), np.empty((len(sequence), 3))
    for channel in range(3):
        inlier = ~outlier[:, channel]
        stamps_s = navigation.timestamps_s[inlier]
        values[:, channel] = np.interp(sequence.timestamps_s, stamps_s, readings[inlier, channel])
        sharing = frames_per_reading(stamps_s, sequence.timestamps_s, navigation.timestamps_s)
        shared_sigma[:, channel] = sigma[channel] * np.sqrt(sharing)
    gap = ~np.isfinite(frames_per_reading(navigation.timestamps_s, sequence.timestamps_s))
    diagnostics = (*_diagnose_outliers(outlier, deviation, sigma), *_diagnose_gaps(gap))
    return DepthAttitude(values, shared_sigma, diagnostics)


def stack_readings(navigation: Navigation) -> FloatArray:
    """Return the readings as (R, 3) z_m, roll_rad, pitch_rad; the roll is unwrapped along R."""
    return np.stack([navigation.z_m, np.unwrap(navigation.roll_rad), navigation.pitch_rad], axis=1)


def frames_per_reading(
    reading_s: FloatArray, frame_s: FloatArray, all_readings_s: FloatArray | None = None
) -> FloatArray:
    """Count how many frames share the information of one reading.

    Args:
        reading_s: (R,) rising stamps of the readings.
        frame_s: (M,) rising stamps of the frames.
        all_readings_s: stamps before outliers were rejected, from which the median interval of the readings is taken;
            those of the readings where None.

    Returns:
        (M,) number of frames for each frame, at least 1; infinite where no reading is near.
    """
    if not len(reading_s):
        return np.full(len(frame_s), np.inf)
    recorded_s = reading_s if all_readings_s is None else all_readings_s
    interval_s = median_interval_s(recorded_s)
    frame_interval_s = median_interval_s(frame_s, interval_s)
    nearest_s, gap_s = measure_gaps(reading_s, frame_s)
    bridged = gap_s <= longest_bridge_s(interval_s)
    near = nearest_s <= 0.5 * max(interval_s, frame_interval_s) + SAME_TIME_S
    share = np.where(bridged, np.maximum(gap_s / max(frame_interval_s, 1e-12), 1.0), 1.0)
    share = np.where(nearest_s <= SAME_TIME_S, np.minimum(share, 1.0), share)
    return np.asarray(np.where(bridged | near, share, np.inf))


def _sensor_sigma(sequence: Sequence) -> FloatArray:
    noise = sequence.noise
    return np.array([noise.navigation_z_m, noise.navigation_roll_rad, noise.navigation_pitch_rad])


def _odometry_sigma(sequence: Sequence, odometry: Trajectory | None) -> FloatArray:
    if odometry is None:
        return np.zeros(3)
    noise = sequence.noise
    return np.array([noise.odometry_translation_m, noise.odometry_rotation_rad, noise.odometry_rotation_rad])


def _detrend(readings: FloatArray, navigation: Navigation, odometry: Trajectory | None) -> FloatArray:
    """Subtract the odometry's height, roll and pitch from (R, 3) readings; the rest varies slowly."""
    if odometry is None:
        return readings
    poses = interpolate(odometry.timestamps_s, odometry.world_from_vehicle, navigation.timestamps_s)
    return readings - depth_roll_pitch(poses)


def _diagnose_outliers(outlier: BoolArray, deviation: FloatArray, sigma: FloatArray) -> list[Diagnostic]:
    found = []
    for channel, (name, (scale, unit)) in enumerate(zip(CHANNELS, UNITS, strict=True)):
        count = int(outlier[:, channel].sum())
        if count:
            worst = scale * float(deviation[outlier[:, channel], channel].max())
            message = (
                f"navigation: {count} of {len(outlier)} {name} readings differ from their neighbours by up to "
                f"{worst:.3g} {unit}, where the stated sigma is {scale * float(sigma[channel]):.2g} {unit}: rejected"
            )
            found.append(Diagnostic("navigation-outliers", message))
    return found


def _diagnose_gaps(gap: BoolArray) -> list[Diagnostic]:
    if not gap.any():
        return []
    runs = frame_runs(gap)
    message = (
        f"navigation: no reading near {int(gap.sum())} of {len(gap)} frames ({format_runs(runs)}): depth and attitude "
        "do not constrain them"
    )
    return [Diagnostic("navigation-gap", message, runs)]
