"""Covariances and warnings of the mirror image: reflected points, equal certainty, and the distance to report."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest

from asfm.backend.ambiguity.mirror_ambiguity import choose_mirror, find_mirror, inflate_for_mirror, warn_of_mirror
from asfm.backend.graph.marginal_covariance import measure_uncertainty
from asfm.geometry.reflection import reflect
from asfm.types import FloatArray
from tests.backend.ambiguity.test_mirror_ambiguity import FRAMES, LEVER_ARM, make_solution


def outer(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors[:, :, None] * vectors[:, None])


def test_covariances_of_points_are_reflected_with_the_points() -> None:
    """The columns of a root of each covariance are displacements, reflected one by one."""
    solution, _, _ = make_solution()
    bundle, mirror = solution.bundle, find_mirror(solution)
    root = np.random.default_rng(0).normal(0, 0.1, (len(bundle.xyz_m), 3, 3))
    inside = measure_uncertainty(bundle, solution.elevation_information_ratio)
    inside = replace(inside, point_m2=root @ np.swapaxes(root, 1, 2))
    image_m2 = outer(mirror.xyz_m - bundle.xyz_m)
    for column in range(3):
        _, moved = reflect(bundle.world_from_vehicle, bundle.xyz_m + root[:, :, column], LEVER_ARM)
        image_m2 += outer(moved - mirror.xyz_m)
    share = mirror.probability
    expected = (1 - share) * inside.point_m2 + share * image_m2
    np.testing.assert_allclose(inflate_for_mirror(inside, solution, mirror).point_m2, expected, atol=1e-9)


def test_the_image_that_is_chosen_is_as_certain_as_the_one_that_was_found() -> None:
    """Reflection keeps the principal sigmas of every point, of which each has one prior of the aperture."""
    found, _, _ = make_solution(slope=-0.1)
    shown = choose_mirror(found)
    assert shown is not found and shown.bundle.graph.size() == found.bundle.graph.size()
    sigma_m = [
        np.sqrt(np.linalg.eigvalsh(measure_uncertainty(each.bundle, each.elevation_information_ratio).point_m2))
        for each in (found, shown)
    ]
    np.testing.assert_allclose(sigma_m[1], sigma_m[0], rtol=1e-3)


@pytest.mark.parametrize(("sigmas", "count"), [(2.9, 0), (3.1, 1)])
def test_images_are_reported_from_three_sigmas_on(sigmas: float, count: int) -> None:
    solution, _, _ = make_solution()
    mirror = find_mirror(solution)
    distances = [
        np.linalg.norm(gtsam.Pose3(here).localCoordinates(gtsam.Pose3(there)))
        for here, there in zip(solution.bundle.world_from_vehicle, mirror.world_from_vehicle, strict=True)
    ]
    inside = measure_uncertainty(solution.bundle, solution.elevation_information_ratio)
    alike = replace(inside, pose=np.tile((max(distances) / sigmas) ** 2 * np.eye(6), (FRAMES, 1, 1)))
    assert len(warn_of_mirror(alike, solution.bundle, mirror)) == count
