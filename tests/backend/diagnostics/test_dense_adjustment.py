"""Dense adjustment: the cost and the optimum of the factor graph, from elsewhere too."""

from dataclasses import replace

import numpy as np
import pytest

from asfm.backend.diagnostics.dense_adjustment import adjust_densely
from asfm.backend.estimation.solution import Solution
from asfm.geometry.poses import invert, transform
from tests.backend.diagnostics.solved import solve_vehicle
from tests.worlds import make_vehicle_sequence

STAMPS_S = make_vehicle_sequence().timestamps_s


@pytest.fixture(scope="module")
def solved() -> Solution:
    return solve_vehicle()


def test_the_optimum_of_the_factor_graph_is_the_dense_one(solved: Solution) -> None:
    """Oracle: GTSAM's cost, which no other optimum undercuts."""
    fit = adjust_densely(solved, STAMPS_S)
    cost = solved.bundle.measured.error(solved.bundle.values)
    assert fit.cost == pytest.approx(cost, rel=0.02)
    np.testing.assert_allclose(fit.world_from_vehicle[:, :3, 3], solved.bundle.world_from_vehicle[:, :3, 3], atol=0.02)


def test_it_is_found_from_elsewhere(solved: Solution) -> None:
    rng = np.random.default_rng(0)
    poses = solved.bundle.world_from_vehicle.copy()
    poses[:, :3, 3] += rng.normal(0, 0.05, (len(poses), 3))
    points = solved.bundle.xyz_m + rng.normal(0, 0.05, solved.bundle.xyz_m.shape)
    moved = replace(solved, bundle=replace(solved.bundle, world_from_vehicle=poses, xyz_m=points))
    here, there = adjust_densely(solved, STAMPS_S), adjust_densely(moved, STAMPS_S)
    assert there.cost == pytest.approx(here.cost, rel=0.02)


def test_points_stay_inside_the_aperture(solved: Solution) -> None:
    half_rad = float(np.deg2rad(2.0))
    narrow = replace(solved, problem=replace(solved.problem, half_aperture_rad=half_rad))
    fit, tracks = adjust_densely(narrow, STAMPS_S), solved.tracks
    world_from_sonar = fit.world_from_vehicle @ solved.problem.vehicle_from_sonar
    xyz_m = transform(invert(world_from_sonar)[tracks.frame], fit.xyz_m[tracks.track])
    elevation_rad = np.arctan2(xyz_m[:, 2], np.linalg.norm(xyz_m[:, :2], axis=1))
    assert np.percentile(np.abs(elevation_rad), 95) < half_rad + np.deg2rad(1.0)
    assert fit.cost > adjust_densely(solved, STAMPS_S).cost


def test_a_hopeless_cost_ends_it_early(solved: Solution) -> None:
    points = solved.bundle.xyz_m + np.random.default_rng(0).normal(0, 0.3, solved.bundle.xyz_m.shape)
    moved = replace(solved, bundle=replace(solved.bundle, xyz_m=points))
    assert adjust_densely(moved, STAMPS_S, hopeless_cost=-1e9).cost >= adjust_densely(moved, STAMPS_S).cost
