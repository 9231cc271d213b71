"""Dense problem: whitened residuals of exact observations vanish, and scale with the sigmas."""

from dataclasses import replace

import numpy as np

from asfm.backend.graph.dense_problem import elevation_sigma, observed_points, scale_sigmas, whiten
from asfm.geometry.poses import invert, transform
from tests.backend.graph.test_dense_bundle import make_problem


def test_residuals_vanish_at_the_truth() -> None:
    problem, poses, xyz_m = make_problem()
    np.testing.assert_allclose(whiten(problem, poses, xyz_m), 0, atol=1e-9)
    expected = transform(invert(poses)[problem.frame], xyz_m[problem.track])
    np.testing.assert_allclose(observed_points(problem, poses, xyz_m), expected, atol=1e-12)


def test_wider_sigmas_divide_the_residuals() -> None:
    problem, poses, xyz_m = make_problem(noise=1.0)
    np.testing.assert_allclose(whiten(scale_sigmas(problem, 4.0), poses, xyz_m), whiten(problem, poses, xyz_m) / 4)


def test_all_views_of_a_point_together_state_its_elevation_once() -> None:
    problem = replace(make_problem()[0], elevation_sigma_rad=0.2)
    precision = np.bincount(problem.track, elevation_sigma(problem) ** -2.0)
    np.testing.assert_allclose(precision, 0.2**-2.0)
