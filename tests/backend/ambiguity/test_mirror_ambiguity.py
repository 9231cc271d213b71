"""Mirror ambiguity: reflection, choice of the image, and covariances over both images."""

from dataclasses import replace
from functools import lru_cache

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.backend.ambiguity.mirror_ambiguity import (
    choose_mirror,
    find_mirror,
    inflate_for_mirror,
    warn_of_mirror,
)
from asfm.backend.estimation.solution import Solution
from asfm.backend.graph.bundle_adjustment import Bundle, adjust_bundle
from asfm.backend.graph.marginal_covariance import Uncertainty, measure_uncertainty
from asfm.backend.graph.problem import BundleProblem
from asfm.config import Scene
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.reflection import reflect
from asfm.geometry.sonar import SonarModel, project
from asfm.navigation.sensor_constraints import SensorConstraints
from asfm.sequence import Sequence
from asfm.types import FloatArray, Tracks
from tests.worlds import make_constraints, no_frame

SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.7, 0.7), (500, 128), np.deg2rad(20))
LEVER_ARM = make_pose(np.array([0.4, -0.1, -0.2]), Rotation.from_euler("ZYX", [0.1, 0.2, 0.0]))
FRAMES = 20
SIGMA = np.array([0.01, 0.005])


def make_poses() -> FloatArray:
    """Make (N, 4, 4) poses from the identity on, with rolls of some twenty degrees and little change of height."""
    along = np.arange(FRAMES)
    angles = np.stack([0.2 * np.sin(along / 9), 0.05 * np.sin(along / 5), 0.4 * np.sin(along / 6)], axis=1)
    position = np.stack([0.01 * along, 0.03 * along, 0.1 * np.sin(along / 6)], axis=1)
    return make_pose(position, Rotation.from_euler("ZYX", angles))


def make_sensors(poses: FloatArray, kind: str) -> SensorConstraints:
    """Make true steps for "odometry", else a prior of little motion, with depth and attitude for "attitude"."""
    sequence = Sequence("made up", SONAR, np.arange(FRAMES, dtype=float), no_frame, LEVER_ARM)
    measured = kind == "odometry"
    held = poses if measured else np.repeat(poses[:1], FRAMES, axis=0)
    steps = np.tile([0.005, 0.01] if measured else [0.2, 0.2], (FRAMES - 1, 1))
    sensors = make_constraints(sequence, held, steps, measured)
    if kind != "attitude":
        return sensors
    _, pitch, roll = Rotation.from_matrix(poses[:, :3, :3]).as_euler("ZYX").T
    read = np.stack([poses[:, 2, 3], roll, pitch], axis=1)
    return replace(sensors, z_roll_pitch=read, z_roll_pitch_sigma=np.full((FRAMES, 3), 0.01))


def make_solution(kind: str = "alone", seed: int = 0, slope: float = 0.1) -> tuple[Solution, FloatArray, FloatArray]:
    """Adjust a scene whose points rise with their distance by a slope, with the truth as initial values.

    Returns:
        The solution, (N, 4, 4) true poses and (T, 3) true points.
    """
    return _adjust_scene(kind, seed, slope)


@lru_cache
def _adjust_scene(kind: str, seed: int, slope: float) -> tuple[Solution, FloatArray, FloatArray]:
    rng = np.random.default_rng(seed)
    poses = make_poses()
    in_sonar = rng.uniform([3.0, -2.0, -0.3], [6.0, 3.0, 0.3], (60, 3))
    in_sonar[:, 2] += slope * (in_sonar[:, 0] - 4.5)
    points = transform(poses[0] @ LEVER_ARM, in_sonar)
    seen = transform(invert(poses @ LEVER_ARM), points[:, None])
    track, frame = np.nonzero(SONAR.sees(seen))
    range_m, bearing_rad, _ = project(seen[track, frame])
    error = rng.normal(0, SIGMA, (len(track), 2))
    tracks = Tracks(track, frame, range_m + error[:, 0], bearing_rad + error[:, 1])
    observed = np.ones(len(tracks), dtype=bool)
    sigma = np.tile(SIGMA, (len(tracks), 1))
    problem = BundleProblem(
        tracks, observed, sigma, make_sensors(poses, kind), LEVER_ARM, SONAR.elevation_aperture_rad / 2
    )
    points = points[: tracks.count]
    bundle = adjust_bundle(problem, poses, points)
    return Solution(tracks, observed, bundle, problem, np.ones(tracks.count)), poses, points


def mirror_solution(solution: Solution) -> Solution:
    """Return the mirror image of a solution."""
    poses, points = reflect(solution.bundle.world_from_vehicle, solution.bundle.xyz_m, LEVER_ARM)
    values = gtsam.Values()
    for index, pose in enumerate(poses):
        values.insert(gtsam.symbol("x", index), gtsam.Pose3(pose))
    for index in np.flatnonzero(solution.bundle.in_graph).tolist():
        values.insert(gtsam.symbol("l", index), points[index])
    return replace(solution, bundle=replace(solution.bundle, world_from_vehicle=poses, xyz_m=points, values=values))


def adjust(solution: Solution) -> Solution:
    """Optimise again from a solution."""
    bundle = solution.bundle
    return replace(solution, bundle=adjust_bundle(solution.problem, bundle.world_from_vehicle, bundle.xyz_m))


def inflated(solution: Solution) -> Uncertainty:
    return inflate_for_mirror(
        measure_uncertainty(solution.bundle, solution.elevation_information_ratio), solution, find_mirror(solution)
    )


def pose_nees(bundle: Bundle, covariance: FloatArray, truth: FloatArray) -> float:
    """Return the mean of e' C^-1 e / 6 over all frames but the first."""
    return float(
        np.mean(
            [
                error @ np.linalg.solve(covariance[frame], error) / 6
                for frame in range(1, FRAMES)
                for error in [gtsam.Pose3(bundle.world_from_vehicle[frame]).localCoordinates(gtsam.Pose3(truth[frame]))]
            ]
        )
    )


@pytest.mark.parametrize(("kind", "expected"), [("alone", 0.5), ("odometry", 0.0), ("attitude", 0.0)])
def test_only_other_sensors_exclude_the_mirror_image(kind: str, expected: float) -> None:
    solution, _, _ = make_solution(kind)
    mirror = find_mirror(solution)
    assert mirror.probability == pytest.approx(expected, abs=0.05)
    uncertainty = measure_uncertainty(solution.bundle, solution.elevation_information_ratio)
    diagnostics = warn_of_mirror(uncertainty, solution.bundle, mirror)
    if expected:
        (found,) = diagnostics
        assert found.code == "mirror-ambiguity" and f"not shown: {mirror.probability:.2g}" in found.message
    else:
        assert diagnostics == () and inflate_for_mirror(uncertainty, solution, mirror) is uncertainty


@pytest.mark.parametrize("kind", ["odometry", "attitude"])
def test_the_image_that_sensors_contradict_is_not_chosen(kind: str) -> None:
    solution, truth, _ = make_solution(kind)
    wrong = mirror_solution(solution)
    assert find_mirror(wrong).probability > 0.999
    np.testing.assert_allclose(choose_mirror(wrong).bundle.world_from_vehicle, truth, atol=0.1)
    assert choose_mirror(solution) is solution


@pytest.mark.parametrize("slope", [0.1, -0.1])
def test_of_two_equal_images_the_one_of_a_bottom_is_chosen(slope: float) -> None:
    """Far points lie higher in the chosen image, whichever was the input."""
    found, _, _ = make_solution(slope=slope)
    shown, again = choose_mirror(found), choose_mirror(mirror_solution(found))
    assert (shown is found) == (slope > 0)
    np.testing.assert_allclose(again.bundle.world_from_vehicle, shown.bundle.world_from_vehicle, atol=1e-9)
    assert choose_mirror(shown) is shown
    assert shown.bundle.measured.error(shown.bundle.values) == pytest.approx(
        found.bundle.measured.error(found.bundle.values), rel=0.02
    )


@pytest.mark.parametrize("slope", [0.1, -0.1])
def test_a_scene_known_to_lie_below_or_above_has_one_image(slope: float) -> None:
    found, _, _ = make_solution(slope=slope)
    scene: Scene = "below" if slope > 0 else "above"
    for begun in (found, mirror_solution(found)):
        shown = choose_mirror(begun, scene)
        np.testing.assert_allclose(shown.bundle.world_from_vehicle, found.bundle.world_from_vehicle, atol=1e-9)
        assert find_mirror(shown, scene).probability == 0.0
    assert find_mirror(found).probability > 0.3


def test_a_configured_scene_does_not_overrule_sensors() -> None:
    solution, _, _ = make_solution("odometry")
    assert choose_mirror(solution, "above") is solution
    assert find_mirror(mirror_solution(solution), "above").probability > 0.999


def test_inflated_covariances_are_second_moments_over_both_images() -> None:
    """Compare with samples of the mirror image from its covariance at its own optimum."""
    solution, _, _ = make_solution()
    other = adjust(mirror_solution(solution))
    inside = measure_uncertainty(solution.bundle, solution.elevation_information_ratio)
    image = measure_uncertainty(other.bundle, other.elevation_information_ratio)
    probability = find_mirror(solution).probability
    stated = inflated(solution)
    rng = np.random.default_rng(2)
    for frame in (5, FRAMES - 1):
        here, there = (gtsam.Pose3(s.bundle.world_from_vehicle[frame]) for s in (solution, other))
        drawn = rng.multivariate_normal(np.zeros(6), image.pose[frame], 4000)
        errors = np.array([here.localCoordinates(there.retract(vector)) for vector in drawn])
        expected = (1 - probability) * inside.pose[frame] + probability * errors.T @ errors / len(errors)
        scale = np.sqrt(np.diag(expected))
        np.testing.assert_allclose(
            stated.pose[frame] / scale / scale[:, None], expected / scale / scale[:, None], atol=0.05
        )
    shift_m = other.bundle.xyz_m - solution.bundle.xyz_m
    own = image.point_m2 + shift_m[:, :, None] * shift_m[:, None]
    expected_m2 = (1 - probability) * inside.point_m2 + probability * own
    np.testing.assert_allclose(stated.point_m2, expected_m2, atol=0.03 * np.abs(expected_m2).max())
    np.testing.assert_array_equal(stated.span, inside.span)


def test_inflated_covariances_are_consistent_with_the_errors_of_both_images() -> None:
    """The NEES over 6 is near 1 over both images; with the covariance within one image it is many times more."""
    inside, stated = [], []
    for seed in range(4):
        found, truth, _ = make_solution(seed=seed)
        for solution in (found, adjust(mirror_solution(found))):
            covariance = measure_uncertainty(solution.bundle, solution.elevation_information_ratio).pose
            inside.append(pose_nees(solution.bundle, covariance, truth))
            stated.append(pose_nees(solution.bundle, inflated(solution).pose, truth))
    assert 0.5 < np.mean(stated) < 1.5
    assert np.mean(inside[::2]) < 1.5 and np.mean(inside[1::2]) > 20
