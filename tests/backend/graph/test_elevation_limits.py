"""Elevations in bundle adjustment: bounds that measurements contradict, short moves, and the tolerance of the cost."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.backend.graph import bundle_adjustment
from asfm.backend.graph.aperture_bounds import observed_elevations
from asfm.backend.graph.bundle_adjustment import adjust_bundle
from asfm.backend.graph.problem import FIRST_POINT, FIRST_POSE, BundleProblem
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import project
from asfm.types import FloatArray, Tracks
from tests.backend.graph.test_bundle_adjustment import LEVER_ARM, SIGMA, make_world


def test_bounds_hold_against_measurements_that_contradict_them() -> None:
    """The points lie up to 0.07 rad beyond the stated aperture: the bounds give way by a few of their sigmas."""
    world, half_rad = make_world(1, noise=0.3, drift=0.3, frame_count=6, points=40), 0.05
    beyond_rad = []
    for stated_rad in (half_rad, world.problem.half_aperture_rad):
        problem = replace(world.problem, half_aperture_rad=stated_rad)
        bundle = adjust_bundle(problem, world.start_poses, world.start_xyz_m)
        elevation_rad = observed_elevations(problem, bundle.world_from_vehicle, bundle.xyz_m)
        beyond_rad.append(float(np.abs(elevation_rad).max()) - half_rad)
    assert beyond_rad[0] < 0.03 < 0.06 < beyond_rad[1]


def make_small_motion(seed: int) -> tuple[BundleProblem, FloatArray, FloatArray]:
    """Let a sonar that moves by millimetres observe points, so that it hardly observes their elevations."""
    world, rng, count = make_world(seed, frame_count=5, points=25), np.random.default_rng(seed), 5
    small = make_pose(rng.normal(0, 0.003, (count, 3)), Rotation.from_rotvec(rng.normal(0, 0.003, (count, 3))))
    poses = world.poses[:1] @ small
    seen = transform(invert(poses @ LEVER_ARM), world.xyz_m[:, None])
    track, frame = np.nonzero(np.ones(seen.shape[:2]))
    range_m, bearing_rad, _ = project(seen[track, frame])
    error = rng.normal(0, SIGMA, (len(track), 2))
    problem = replace(
        world.problem,
        tracks=Tracks(track, frame, range_m + error[:, 0], bearing_rad + error[:, 1]),
        observed=np.ones(len(track), dtype=bool),
        sigma=np.tile(SIGMA, (len(track), 1)),
        sensors=replace(world.problem.sensors, first_pose=poses[0], steps=invert(poses[:-1]) @ poses[1:]),
    )
    return problem, poses, world.xyz_m


def elevations_of(problem: BundleProblem, values: gtsam.Values, xyz_m: FloatArray) -> FloatArray:
    poses = np.stack([values.atPose3(FIRST_POSE + index).matrix() for index in range(5)])
    points = np.stack([values.atPoint3(FIRST_POINT + index) for index in range(len(xyz_m))])
    return observed_elevations(problem, poses, points)


@pytest.mark.parametrize("seed", [0, 1])
def test_elevations_that_are_hardly_observed_move_little_between_two_updates(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In one step from the true points, which the noise of the measurements would move across the aperture."""
    problem, poses, xyz_m = make_small_motion(seed)
    optimise, moves = bundle_adjustment._optimise, []

    def watch(graph: gtsam.NonlinearFactorGraph, initial: gtsam.Values) -> gtsam.Values:
        found = optimise(graph, initial)
        before, after = (elevations_of(problem, values, xyz_m) for values in (initial, found))
        moves.append(float(np.abs(after - before).max()) / problem.half_aperture_rad)
        return found

    monkeypatch.setattr(bundle_adjustment, "_optimise", watch)
    adjust_bundle(problem, poses, xyz_m)
    assert len(moves) > 2 and max(moves) < 0.7


def test_a_tighter_tolerance_ends_at_a_lower_cost() -> None:
    world = make_world(3, frame_count=8, points=30)
    costs = []
    for tolerance in (1e-1, 1e-6, 1e-9):
        bundle = adjust_bundle(world.problem, world.start_poses, world.start_xyz_m, tolerance)
        costs.append(bundle.measured.error(bundle.values))
    assert costs[0] > costs[1] > costs[2]
