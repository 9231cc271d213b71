"""Viewpoint: path and landmarks are in view, from above."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from asfm.geometry.poses import make_pose, transform
from asfm.geometry.sonar import SonarModel
from asfm.types import FloatArray
from asfm.visualization.viewpoint import choose_viewpoint

SONAR = SonarModel.evenly_spaced("toy", (0.5, 8.0), (-0.6, 0.5), (150, 110), 0.2)


def _angles(eye_m: FloatArray, target_m: FloatArray, xyz_m: FloatArray) -> FloatArray:
    """Return (N, 2) angles in degrees beside and above the line of sight of a level eye."""
    sight = target_m - eye_m
    level = Rotation.from_euler("ZY", [np.arctan2(sight[1], sight[0]), -np.arctan2(sight[2], np.hypot(*sight[:2]))])
    ahead, left, up = np.moveaxis(level.inv().apply(xyz_m - eye_m), -1, 0)
    return np.asarray(np.rad2deg(np.abs(np.arctan2([left, up], ahead))).T)


@given(heading_rad=st.floats(-3.1, 3.1), pitch_rad=st.floats(-1.5, np.pi / 2), seed=st.integers(0, 20))
@settings(max_examples=60, deadline=None)
def test_eye_sees_path_and_landmarks_from_above(heading_rad: float, pitch_rad: float, seed: int) -> None:
    """For any sonar attitude; an eye exactly above the target would have no defined up direction."""
    rng = np.random.default_rng(seed)
    attitude = Rotation.from_euler("ZYX", [[heading_rad, pitch_rad, 0.0]] * 9)
    poses = make_pose(rng.normal(size=3) * 30 + rng.normal(size=(9, 3)) * 0.3, attitude)
    seen_m = transform(poses[rng.integers(0, 9, 300)], rng.uniform([2, -2, -1], [7, 2, 1], (300, 3)))
    seen_m[0] += 1000  # one outlier must not move the eye away
    viewpoint = choose_viewpoint(SONAR, poses, seen_m)
    offset_m = viewpoint.eye_m - viewpoint.target_m
    distance_m = np.linalg.norm(offset_m)
    assert np.hypot(*offset_m[:2]) > 0.3 * distance_m and offset_m[2] > 0.3 * distance_m
    inside = np.all(_angles(viewpoint.eye_m, viewpoint.target_m, seen_m) < np.array([41.0, 25.0]), axis=1)
    assert inside.mean() > 0.93 and not inside[0]
    assert distance_m < 4 * np.ptp(np.concatenate([poses[:, :3, 3], seen_m[1:]]), axis=0).max()
    assert (_angles(viewpoint.eye_m, viewpoint.target_m, poses[:, :3, 3]) < np.array([41.0, 25.0])).all()
    heights_m = np.concatenate([poses[:, 2, 3], seen_m[1:, 2]])
    assert heights_m.min() <= viewpoint.floor_m <= np.quantile(heights_m, 0.05)
