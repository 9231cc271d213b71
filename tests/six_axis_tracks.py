"""Tracks of points seen from a sonar that rolls and pitches as much as it yaws."""

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.reflection import reflect_after
from asfm.geometry.sonar import SonarModel, project
from asfm.types import FloatArray, Tracks

SONAR = SonarModel.evenly_spaced("six axes", (0.3, 6.0), (-0.55, 0.55), (400, 256), float(np.deg2rad(20)))
NOISE = np.array([0.004, np.deg2rad(0.05)])


def make_path(frames: int, turn_deg: float = 3.0) -> FloatArray:
    """Return (N, 4, 4) poses along a curve, with independent roll and pitch of a few degrees a frame."""
    angle = np.linspace(0, 1.5, frames)
    rng = np.random.default_rng(5)
    attitude_rad = np.deg2rad(turn_deg) * rng.uniform(-1, 1, (frames, 2))
    attitude_rad[0] = 0
    rotation = Rotation.from_euler("ZYX", np.column_stack([0.6 * angle, attitude_rad]))
    return make_pose(np.column_stack([2 * np.sin(angle), 2 - 2 * np.cos(angle), 0.1 * np.sin(2 * angle)]), rotation)


def observe(world_from_sonar: FloatArray, count: int = 160, noise: float = 1.0) -> Tracks:
    """Observe random points around a path with a noise of 4 mm and 0.05 degrees, times a factor."""
    rng = np.random.default_rng(6)
    xyz_m = np.column_stack([rng.uniform(1, 8, count), rng.uniform(-3, 5, count), rng.uniform(-0.7, 0.7, count)])
    in_sonar = transform(invert(world_from_sonar), xyz_m[:, None])
    track, frame = np.nonzero(SONAR.sees(in_sonar))
    range_m, bearing_rad, _ = project(in_sonar[track, frame])
    drawn = noise * NOISE * rng.normal(size=(len(track), 2))
    track = np.unique(track, return_inverse=True)[1]
    sigma = np.tile(NOISE, (len(track), 1))
    return Tracks(track, frame, range_m + drawn[:, 0], bearing_rad + drawn[:, 1], sigma)


def measure_errors(world_from_sonar: FloatArray, truth: FloatArray) -> tuple[float, float]:
    """Return the rms errors of position in m and of rotation in degrees from the nearer of truth and mirror image.

    All begin at the same pose.
    """
    errors = []
    for image in (truth, reflect_after(truth, 0, np.eye(4))):
        difference = invert(image) @ world_from_sonar
        rotation_rad = Rotation.from_matrix(difference[:, :3, :3]).magnitude()
        position_m = np.linalg.norm(difference[:, :3, 3], axis=1)
        errors.append((float(np.sqrt(np.mean(position_m**2))), float(np.degrees(np.sqrt(np.mean(rotation_rad**2))))))
    return min(errors, key=lambda error: error[1])
