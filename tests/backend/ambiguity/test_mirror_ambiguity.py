"""What the sonar alone cannot tell from its mirror image is found, weighed and counted in what is stated."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.backend.ambiguity.mirror_ambiguity import (
    choose_mirror,
    find_mirror,
    inflate_for_mirror,
    reflect,
    warn_of_mirror,
)
from asfm.backend.estimation.solution import Solution
from asfm.backend.graph.bundle_adjustment import Bundle, adjust_bundle
from asfm.backend.graph.marginal_covariance import Uncertainty, measure_uncertainty
from asfm.backend.graph.problem import BundleProblem
from asfm.config import Scene
from asfm.geometry.poses import invert, make_pose, transform
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
    """(N, 4, 4) from the identity on, with rolls of some twenty degrees and little height."""
    along = np.arange(FRAMES)
    angles = np.stack([0.2 * np.sin(along / 9), 0.05 * np.sin(along / 5), 0.4 * np.sin(along / 6)], axis=1)
    position = np.stack([0.01 * along, 0.03 * along, 0.1 * np.sin(along / 6)], axis=1)
    return make_pose(position, Rotation.from_euler("ZYX", angles))


def make_sensors(poses: FloatArray, kind: str) -> SensorConstraints:
    """Steps of the true motion where there is odometry, else a prior that the vehicle moves little; or attitudes."""
    sequence = Sequence("made up", SONAR, np.arange(FRAMES, dtype=float), no_frame, LEVER_ARM)
    measured = kind == "odometry"
    held = poses if measured else np.repeat(poses[:1], FRAMES, axis=0)
    steps = np.tile([0.005, 0.01] if measured else [0.2, 0.2], (FRAMES - 1, 1))
    sensors = make_constraints(sequence, held, steps, measured)
    if kind != "levels":
        return sensors
    _, pitch, roll = Rotation.from_matrix(poses[:, :3, :3]).as_euler("ZYX").T
    read = np.stack([poses[:, 2, 3], roll, pitch], axis=1)
    return replace(sensors, z_roll_pitch=read, z_roll_pitch_sigma=np.full((FRAMES, 3), 0.01))


def make_solution(kind: str = "alone", seed: int = 0, slope: float = 0.1) -> tuple[Solution, FloatArray, FloatArray]:
    """Adjust a scene whose points lie the higher the farther they are, from the truth on.

    Returns:
        the solution, the true poses (N, 4, 4) and the true points (T, 3).
    """
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


def show_other(solution: Solution) -> Solution:
    """Put the mirror image into a solution's place."""
    poses, points = reflect(solution.bundle.world_from_vehicle, solution.bundle.xyz_m, LEVER_ARM)
    values = gtsam.Values()
    for index, pose in enumerate(poses):
        values.insert(gtsam.symbol("x", index), gtsam.Pose3(pose))
    for index in np.flatnonzero(solution.bundle.in_graph).tolist():
        values.insert(gtsam.symbol("l", index), points[index])
    return replace(solution, bundle=replace(solution.bundle, world_from_vehicle=poses, xyz_m=points, values=values))


def adjust(solution: Solution) -> Solution:
    """Optimise once more from where a solution is."""
    bundle = solution.bundle
    return replace(solution, bundle=adjust_bundle(solution.problem, bundle.world_from_vehicle, bundle.xyz_m))


def state(solution: Solution) -> Uncertainty:
    return inflate_for_mirror(
        measure_uncertainty(solution.bundle, solution.elevation_information_ratio), solution, find_mirror(solution)
    )


def square_errors(bundle: Bundle, covariance: FloatArray, truth: FloatArray) -> float:
    """Mean over the frames but the first of e' C^-1 e / 6."""
    return float(
        np.mean(
            [
                error @ np.linalg.solve(covariance[frame], error) / 6
                for frame in range(1, FRAMES)
                for error in [gtsam.Pose3(bundle.world_from_vehicle[frame]).localCoordinates(gtsam.Pose3(truth[frame]))]
            ]
        )
    )


def test_the_sonar_measures_the_same_in_the_mirror() -> None:
    rng = np.random.default_rng(1)
    poses, points = make_poses(), rng.uniform(-5, 5, (30, 3))
    image, mirrored = reflect(poses, points, LEVER_ARM)
    here = project(transform(invert(poses @ LEVER_ARM), points[:, None]))
    there = project(transform(invert(image @ LEVER_ARM), mirrored[:, None]))
    for one, other, sign in zip(here, there, (1, 1, -1), strict=True):
        np.testing.assert_allclose(other, sign * one, atol=1e-12)
    np.testing.assert_array_equal(image[0], poses[0])
    assert np.linalg.norm(image[-1] - poses[-1]) > 0.1
    back, again = reflect(image, mirrored, LEVER_ARM)
    np.testing.assert_allclose(back, poses, atol=1e-12)
    np.testing.assert_allclose(again, points, atol=1e-12)


@pytest.mark.parametrize(("kind", "expected"), [("alone", 0.5), ("odometry", 0.0), ("levels", 0.0)])
def test_only_other_sensors_tell_the_images_apart(kind: str, expected: float) -> None:
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


@pytest.mark.parametrize("kind", ["odometry", "levels"])
def test_the_image_that_sensors_contradict_is_left(kind: str) -> None:
    solution, truth, _ = make_solution(kind)
    wrong = show_other(solution)
    assert find_mirror(wrong).probability > 0.999
    np.testing.assert_allclose(choose_mirror(wrong).bundle.world_from_vehicle, truth, atol=0.1)
    assert choose_mirror(solution) is solution


@pytest.mark.parametrize("slope", [0.1, -0.1])
def test_of_two_equal_images_a_bottom_is_shown(slope: float) -> None:
    """Whichever image was found, the one is shown in which what is far lies higher."""
    found, _, _ = make_solution(slope=slope)
    shown, again = choose_mirror(found), choose_mirror(show_other(found))
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
    for begun in (found, show_other(found)):
        shown = choose_mirror(begun, scene)
        np.testing.assert_allclose(shown.bundle.world_from_vehicle, found.bundle.world_from_vehicle, atol=1e-9)
        assert find_mirror(shown, scene).probability == 0.0
    assert find_mirror(found).probability > 0.3


def test_a_scene_said_to_lie_elsewhere_does_not_overrule_sensors() -> None:
    solution, _, _ = make_solution("odometry")
    assert choose_mirror(solution, "above") is solution
    assert find_mirror(show_other(solution), "above").probability > 0.999


def test_what_is_stated_is_the_second_moment_over_both_images() -> None:
    """The image's own covariance, measured at its own optimum, drawn from and seen from the estimate."""
    solution, _, _ = make_solution()
    other = adjust(show_other(solution))
    inside = measure_uncertainty(solution.bundle, solution.elevation_information_ratio)
    image = measure_uncertainty(other.bundle, other.elevation_information_ratio)
    probability = find_mirror(solution).probability
    stated = state(solution)
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


def test_errors_of_either_image_are_as_large_as_stated() -> None:
    """Noise is as stated: e' C^-1 e / 6 is near 1 over both images; of one image alone, many times more."""
    inside, stated = [], []
    for seed in range(4):
        found, truth, _ = make_solution(seed=seed)
        for solution in (found, adjust(show_other(found))):
            covariance = measure_uncertainty(solution.bundle, solution.elevation_information_ratio).pose
            inside.append(square_errors(solution.bundle, covariance, truth))
            stated.append(square_errors(solution.bundle, state(solution).pose, truth))
    assert 0.5 < np.mean(stated) < 1.5
    assert np.mean(inside[::2]) < 1.5 and np.mean(inside[1::2]) > 20
