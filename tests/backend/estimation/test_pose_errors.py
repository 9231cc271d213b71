"""Removal of pose errors from residuals: exact for small errors, six degrees of freedom a frame for noise."""

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.backend.estimation.pose_errors import remove_pose_errors
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import project
from asfm.types import FloatArray, Tracks

FRAMES, POINTS = 6, 80
SIGMA = np.array([0.02, 0.005])


def observe(world_from_sonar: FloatArray, xyz_m: FloatArray) -> FloatArray:
    """Range and bearing of every point in every frame: (POINTS * FRAMES, 2), a track a point."""
    seen = transform(invert(world_from_sonar)[None], xyz_m[:, None])
    return np.stack(project(seen)[:2], axis=-1).reshape(-1, 2)


def make_scene(seed: int) -> tuple[FloatArray, FloatArray, Tracks]:
    rng = np.random.default_rng(seed)
    poses = np.stack(
        [make_pose(rng.normal(0, 0.3, 3), Rotation.from_rotvec(rng.normal(0, 0.1, 3))) for _ in range(FRAMES)]
    )
    xyz_m = rng.uniform([3, -2, -0.8], [7, 2, 0.8], (POINTS, 3))
    places = observe(poses, xyz_m)
    track, frame = np.divmod(np.arange(POINTS * FRAMES), FRAMES)
    return poses, xyz_m, Tracks(track, frame, places[:, 0], places[:, 1])


def test_small_pose_errors_are_removed() -> None:
    poses, xyz_m, tracks = make_scene(0)
    rng = np.random.default_rng(1)
    off = np.stack([make_pose(rng.normal(0, 2e-4, 3), Rotation.from_rotvec(rng.normal(0, 2e-4, 3))) for _ in poses])
    wrong = poses @ off
    residual = (observe(wrong, xyz_m) - np.stack([tracks.range_m, tracks.bearing_rad], axis=1)) / SIGMA
    used, sigma = np.ones(len(tracks), dtype=bool), np.tile(SIGMA, (len(tracks), 1))
    left = remove_pose_errors(tracks, used, residual, sigma, xyz_m, wrong)
    assert np.abs(left).max() < 1e-2 * np.abs(residual).max()


def test_feature_noise_loses_six_degrees_of_freedom_per_frame() -> None:
    poses, xyz_m, tracks = make_scene(2)
    used, sigma = np.ones(len(tracks), dtype=bool), np.tile(SIGMA, (len(tracks), 1))
    noise = np.random.default_rng(3).normal(size=(len(tracks), 2))
    left = remove_pose_errors(tracks, used, noise, sigma, xyz_m, poses)
    assert np.isclose((left**2).mean(), 1 - 6 / (2 * POINTS), atol=0.03)
    again = remove_pose_errors(tracks, used, left, sigma, xyz_m, poses)
    np.testing.assert_allclose(again, left, atol=1e-5)


def test_unused_observations_have_no_influence_and_stay() -> None:
    poses, xyz_m, tracks = make_scene(4)
    used = np.ones(len(tracks), dtype=bool)
    used[::3] = False
    used[tracks.frame == 2] = False
    residual = np.random.default_rng(5).normal(size=(len(tracks), 2))
    wild = residual.copy()
    wild[~used] = 1e6
    sigma = np.tile(SIGMA, (len(tracks), 1))
    left = remove_pose_errors(tracks, used, wild, sigma, xyz_m, poses)
    np.testing.assert_array_equal(left[~used], wild[~used])
    np.testing.assert_allclose(left[used], remove_pose_errors(tracks, used, residual, sigma, xyz_m, poses)[used])
    none = np.zeros(len(tracks), dtype=bool)
    np.testing.assert_array_equal(remove_pose_errors(tracks, none, residual, sigma, xyz_m, poses), residual)
