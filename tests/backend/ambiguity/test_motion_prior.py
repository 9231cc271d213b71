"""Motion prior of a sonar without odometry: widened to the size of the motion, and not beyond."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.backend.ambiguity.motion_prior import (
    SPAN_FRAMES,
    state_prior_covariance,
    widen_motion_prior,
    widen_rotation_sigma,
)
from asfm.backend.estimation.solution import Solution, solve_tracks
from asfm.backend.graph.marginal_covariance import measure_uncertainty
from asfm.config_file import load_config
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import SonarModel, project
from asfm.navigation.sensor_constraints import SensorConstraints
from asfm.sequence import Sequence
from asfm.types import FloatArray, Tracks
from tests.worlds import make_constraints, no_frame

SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.7, 0.7), (500, 128), np.deg2rad(20))


def make_sensors(frames: int, sigma: tuple[float, float], measured: bool = False) -> SensorConstraints:
    sequence = Sequence("made up", SONAR, np.arange(frames, dtype=float), no_frame)
    held = np.repeat(np.eye(4)[None], frames, axis=0)
    return make_constraints(sequence, held, np.tile(sigma, (frames - 1, 1)), measured)


def chain(rotation_rad: FloatArray, translation_m: FloatArray) -> FloatArray:
    """Compose (N - 1, 3) rotation vectors and translations to (N, 4, 4) poses."""
    poses = [np.eye(4)]
    for step in make_pose(translation_m, Rotation.from_rotvec(rotation_rad)):
        poses.append(poses[-1] @ step)
    return np.stack(poses)


def test_independent_rotations_give_their_own_sigma() -> None:
    rng = np.random.default_rng(3)
    poses = chain(rng.normal(0, 0.004, (4000, 3)), rng.normal(0, 0.03, (4000, 3)))
    found = widen_rotation_sigma(make_sensors(4001, (1e-4, 2e-4)), poses).step_sigma
    np.testing.assert_allclose(found, np.tile([0.004, 2e-4], (4000, 1)), rtol=0.08)


@pytest.mark.parametrize("frames", [2, 5, 60])
def test_steady_rotations_give_the_sigma_of_their_sum_over_a_span(frames: int) -> None:
    turn, shift = np.array([0.01, 0.0, 0.0]), np.array([0.05, 0.0, 0.0])  # a screw: its steps commute
    poses = chain(np.tile(turn, (frames - 1, 1)), np.tile(shift, (frames - 1, 1)))
    found = widen_rotation_sigma(make_sensors(frames, (1e-6, 0.02)), poses).step_sigma
    root = np.sqrt(min(SPAN_FRAMES, frames - 1) / 3)  # a third of the squares on each axis
    np.testing.assert_allclose(found, np.tile([0.01 * root, 0.02], (frames - 1, 1)))


def test_a_prior_is_never_narrowed() -> None:
    sensors = make_sensors(6, (0.3, 0.4))
    found = widen_rotation_sigma(sensors, np.repeat(np.eye(4)[None], 6, axis=0))
    np.testing.assert_array_equal(found.step_sigma, sensors.step_sigma)


def test_a_standstill_keeps_its_sigma_and_is_no_part_of_the_motions_size() -> None:
    turn, shift = np.array([0.01, 0.0, 0.0]), np.array([0.05, 0.0, 0.0])
    moving = chain(np.tile(turn, (60, 1)), np.tile(shift, (60, 1)))
    poses = np.concatenate([np.repeat(moving[:1], 200, axis=0), moving])
    still = np.arange(260) < 200
    sensors = replace(make_sensors(261, (1e-6, 0.02)), standstill=still)
    found = widen_rotation_sigma(sensors, poses).step_sigma
    np.testing.assert_array_equal(found[still], sensors.step_sigma[still])
    np.testing.assert_allclose(found[~still], np.tile([0.01 * np.sqrt(SPAN_FRAMES / 3), 0.02], (60, 1)))
    np.testing.assert_array_equal(
        widen_rotation_sigma(replace(sensors, standstill=np.ones(260, dtype=bool)), poses).step_sigma,
        sensors.step_sigma,
    )


def make_case() -> tuple[Solution, Sequence, FloatArray]:
    """Solve a motion with slow rolls under a prior that is tight in rotation."""
    frames, rng = 30, np.random.default_rng(5)
    along = np.arange(frames)
    angles = np.stack([0.1 * np.sin(along / 9), 0.1 * np.sin(along / 7), 0.4 * np.sin(along / 10)], axis=1)
    position = np.stack([0.3 * np.sin(along / 8), 0.04 * along, 0 * along], axis=1)
    truth = make_pose(position, Rotation.from_euler("ZYX", angles))
    points = rng.uniform([3.0, -2.0, -0.6], [6.0, 4.0, 0.6], (80, 3))
    seen = transform(invert(truth), points[:, None])
    track, frame = np.nonzero(SONAR.sees(seen))
    range_m, bearing_rad, _ = project(seen[track, frame])
    track = np.unique(track, return_inverse=True)[1]
    sigma = np.tile([0.01, 0.003], (len(track), 1))
    error = rng.normal(0, 0.3, (len(track), 2)) * sigma  # sigmas are widened for correlated errors along a track
    tracks = Tracks(track, frame, range_m + error[:, 0], bearing_rad + error[:, 1], sigma=sigma)
    sequence = Sequence("made up", SONAR, along.astype(float), no_frame)
    tight = solve_tracks(tracks, sequence, truth, make_sensors(frames, (0.01, 0.05)), load_config())
    return tight, sequence, truth


def test_slow_rolls_are_not_biased_after_widening() -> None:
    """A tight prior pulls rolls towards zero by more than two stated sigmas; the widened one does not."""
    tight, sequence, truth = make_case()
    widened = widen_motion_prior(tight, sequence, load_config())
    assert roll_errors(widened, truth) < 2 < roll_errors(tight, truth)
    wider = widened.problem.sensors.step_sigma / tight.problem.sensors.step_sigma
    assert (wider[:, 0] > 2).all() and (wider[:, 1] == 1).all()


def roll_errors(solution: Solution, truth: FloatArray) -> float:
    """Return the root mean square of the roll errors over their stated sigmas, without the first frame."""
    motion = invert(solution.bundle.world_from_vehicle) @ truth
    roll_rad = Rotation.from_matrix(motion[:, :3, :3]).as_rotvec()[1:, 0]
    variance = measure_uncertainty(solution.bundle, solution.elevation_information_ratio).pose[1:, 0, 0]
    return float(np.sqrt(np.mean(roll_rad**2 / variance)))


def test_solutions_with_odometry_or_without_observations_are_returned_unchanged() -> None:
    frames = 4
    poses = np.repeat(np.eye(4)[None], frames, axis=0)
    tracks = Tracks(
        np.zeros(4, dtype=np.int64), np.arange(4), np.full(4, 5.0), np.zeros(4), sigma=np.full((4, 2), 0.01)
    )
    sequence = Sequence("made up", SONAR, np.arange(4.0), no_frame)
    solution = solve_tracks(tracks, sequence, poses, make_sensors(frames, (0.01, 0.01), measured=True), load_config())
    assert widen_motion_prior(solution, sequence, load_config()) is solution
    none = replace(solution, observed=np.zeros(4, dtype=bool))
    none = replace(none, problem=replace(none.problem, sensors=make_sensors(frames, (0.01, 0.01))))
    assert widen_motion_prior(none, sequence, load_config()) is none


def test_stating_a_wide_prior_increases_covariances_and_keeps_poses() -> None:
    """Covariances become those of the same graph with wider steps, and never smaller."""
    tight, _, _ = make_case()
    stated = state_prior_covariance(tight, 1.5)
    assert stated.bundle.values is tight.bundle.values
    before, after = (measure_uncertainty(s.bundle, s.elevation_information_ratio).pose for s in (tight, stated))
    growth = np.linalg.eigvalsh(after - before)
    assert growth.min() > -1e-6 * growth.max() and after[-1, 0, 0] > 1.5 * before[-1, 0, 0]
    unchanged = state_prior_covariance(tight, 1e-3)
    np.testing.assert_allclose(
        measure_uncertainty(unchanged.bundle, unchanged.elevation_information_ratio).pose, before, rtol=1e-9
    )
    wide = stated.problem.sensors.step_sigma
    np.testing.assert_allclose(
        2 * (stated.bundle.measured.error(stated.bundle.values) - tight.bundle.measured.error(tight.bundle.values)),
        square_steps(tight, wide) - square_steps(tight, tight.problem.sensors.step_sigma),
        rtol=1e-6,
    )


def square_steps(solution: Solution, sigma: FloatArray) -> float:
    """Sum the squared whitened residuals of identity steps."""
    poses = solution.bundle.world_from_vehicle
    motion = np.array([gtsam.Pose3.Logmap(gtsam.Pose3(step)) for step in invert(poses[:-1]) @ poses[1:]])
    return float(((motion / np.repeat(sigma, 3, axis=1)) ** 2).sum())
