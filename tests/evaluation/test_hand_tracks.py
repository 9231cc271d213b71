"""Reprojection error of hand-tracked points under a trajectory."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.datasets import open_sequence
from asfm.evaluation.hand_tracks import measure_hand_tracks
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import SonarModel, project
from asfm.types import FloatArray, HandTracks, Trajectory

SONAR = SonarModel.evenly_spaced("test", (0.3, 6.0), (-0.7, 0.7), (500, 256), 0.35)
LEVER = make_pose(np.array([0.4, 0.1, -0.2]), Rotation.from_euler("zyx", [5, 20, -3], degrees=True))


def sway(count: int, seed: int = 0) -> Trajectory:
    """Make a motion in six degrees of freedom that points down at the origin from some metres away."""
    rng = np.random.default_rng(seed)
    phase = np.linspace(0, 2, count)
    offset_m = np.stack([-3 + 0.3 * np.sin(phase), 0.5 * np.cos(2 * phase), 1.0 + 0.3 * np.sin(3 * phase)], axis=1)
    angles = np.stack([0.1 * np.sin(phase), 0.02 * np.cos(phase), 0.3 * np.sin(2 * phase)], axis=1)
    return Trajectory(np.cumsum(rng.uniform(0.1, 0.3, count)), make_pose(offset_m, Rotation.from_euler("zyx", angles)))


def track(trajectory: Trajectory, points_m: FloatArray) -> HandTracks:
    sonar_from_world = invert(trajectory.world_from_vehicle @ LEVER)
    range_m, bearing_rad, _ = project(transform(sonar_from_world[:, None], points_m))
    count = len(points_m)
    return HandTracks(
        timestamps_s=np.repeat(trajectory.timestamps_s, count),
        landmark=np.tile(np.arange(count), len(trajectory.timestamps_s)) * 3,
        range_m=range_m.ravel(),
        bearing_rad=bearing_rad.ravel(),
    )


POINTS = np.array([[0.0, 0.0, 0.0], [0.3, -0.4, 0.1], [-0.2, 0.5, -0.1]])


def test_exact_observations_have_no_residuals() -> None:
    trajectory = sway(12)
    found = measure_hand_tracks(track(trajectory, POINTS), trajectory, SONAR, LEVER)
    assert found is not None
    assert (found.observations, found.landmarks) == (36, 3)
    assert found.range_rmse_m < 1e-7
    assert found.bearing_rmse_rad < 1e-7


def test_residuals_are_independent_of_the_world() -> None:
    trajectory = sway(12)
    elsewhere = make_pose(np.array([500.0, -80, 3]), Rotation.from_euler("zyx", [170, 30, -60], degrees=True))
    moved = replace(trajectory, world_from_vehicle=elsewhere @ trajectory.world_from_vehicle)
    noisy = track(trajectory, POINTS)
    noisy = replace(noisy, range_m=noisy.range_m + np.random.default_rng(1).normal(scale=0.02, size=36))
    here, there = (measure_hand_tracks(noisy, poses, SONAR, LEVER) for poses in (trajectory, moved))
    assert here is not None
    assert there is not None
    assert there.range_rmse_m == pytest.approx(here.range_rmse_m, rel=1e-5)


def test_residuals_are_the_noise_of_the_observations() -> None:
    trajectory, rng = sway(200), np.random.default_rng(2)
    exact = track(trajectory, POINTS)
    noisy = replace(
        exact,
        range_m=exact.range_m + rng.normal(scale=0.03, size=600),
        bearing_rad=exact.bearing_rad + rng.normal(scale=0.01, size=600),
    )
    found = measure_hand_tracks(noisy, trajectory, SONAR, LEVER)
    assert found is not None
    assert found.range_rmse_m == pytest.approx(0.03, rel=0.1)
    assert found.bearing_rmse_rad == pytest.approx(0.01, rel=0.1)


def test_wrong_poses_and_a_missing_lever_arm_have_residuals() -> None:
    trajectory = sway(30)
    tracks = track(trajectory, POINTS)
    drift = make_pose(np.outer(np.linspace(0, 1, 30), [0.3, 0.2, 0.0]), Rotation.identity(30))
    drifting = replace(trajectory, world_from_vehicle=drift @ trajectory.world_from_vehicle)
    for poses, lever in ((drifting, LEVER), (trajectory, np.eye(4))):
        found = measure_hand_tracks(tracks, poses, SONAR, lever)
        assert found is not None
        assert found.range_rmse_m + 3 * found.bearing_rmse_rad > 0.02


def test_observations_outside_the_time_are_left_out() -> None:
    trajectory = sway(12)
    tracks = track(trajectory, POINTS)
    first_half = Trajectory(trajectory.timestamps_s[:6], trajectory.world_from_vehicle[:6])
    found = measure_hand_tracks(tracks, first_half, SONAR, LEVER)
    assert found is not None
    assert found.observations == 18


def test_too_few_views_give_no_measure() -> None:
    trajectory = sway(12)
    for count in (2, 0):
        few = Trajectory(trajectory.timestamps_s[:count], trajectory.world_from_vehicle[:count])
        assert measure_hand_tracks(track(trajectory, POINTS), few, SONAR, LEVER) is None


def test_the_true_poses_of_the_tank_fit_and_static_ones_do_not(shared_data: Path) -> None:
    sequence = open_sequence(shared_data / "oculus_tank_b")
    assert sequence.hand_tracks is not None
    assert sequence.groundtruth is not None
    static = replace(
        sequence.groundtruth,
        world_from_vehicle=np.tile(sequence.groundtruth.world_from_vehicle[:1], (len(sequence), 1, 1)),
    )
    of_true, of_static = (
        measure_hand_tracks(sequence.hand_tracks, poses, sequence.sonar, sequence.vehicle_from_sonar)
        for poses in (sequence.groundtruth, static)
    )
    assert of_true is not None
    assert of_static is not None
    assert of_true.landmarks == 4
    assert of_true.range_rmse_m < 0.005
    assert np.degrees(of_true.bearing_rmse_rad) < 0.2
    assert of_true.range_rmse_m < of_static.range_rmse_m / 10


def test_a_mirrored_bearing_axis_has_residuals_on_the_tank(shared_data: Path) -> None:
    sequence = open_sequence(shared_data / "oculus_tank_b")
    assert sequence.hand_tracks is not None
    assert sequence.groundtruth is not None
    mirrored = replace(sequence.hand_tracks, bearing_rad=-sequence.hand_tracks.bearing_rad)
    found = measure_hand_tracks(mirrored, sequence.groundtruth, sequence.sonar, sequence.vehicle_from_sonar)
    assert found is not None
    assert np.degrees(found.bearing_rmse_rad) > 1


def test_bearings_of_a_sonar_that_looks_astern_are_compared_the_short_way_round() -> None:
    """The points lie on both sides of the bearing of 180 degrees, at which the bearings jump."""
    trajectory, turn = sway(12), make_pose(np.zeros(3), Rotation.from_euler("z", np.pi))
    sonar_from_world = invert(trajectory.world_from_vehicle @ LEVER @ turn)
    range_m, bearing_rad, _ = project(transform(sonar_from_world[:, None], POINTS))
    assert np.ptp(bearing_rad) > 6
    seen = replace(track(trajectory, POINTS), range_m=range_m.ravel(), bearing_rad=bearing_rad.ravel())
    found = measure_hand_tracks(seen, trajectory, SONAR, LEVER @ turn)
    assert found is not None
    assert found.range_rmse_m < 1e-6 and found.bearing_rmse_rad < 1e-6
