"""Typical steps: those of a steady motion anywhere, larger near a manoeuvre, nothing where nothing is supported."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.backend.initialisation.typical_steps import NEAR_STEPS, typical_steps
from asfm.geometry.poses import chain_steps, make_pose
from asfm.types import FloatArray


def chain(speed: FloatArray) -> FloatArray:
    """Chain steps of speed m along x with turns of half that in rad about x."""
    along = np.outer(speed, [1.0, 0.0, 0.0])
    return chain_steps(np.eye(4), make_pose(along, Rotation.from_rotvec(along / 2)))


def test_a_steady_motion_has_its_own_size_everywhere() -> None:
    found = typical_steps(chain(np.full(30, 0.3)), np.ones(30, dtype=bool))
    np.testing.assert_allclose(found, np.tile(np.array([0.15, 0.3]) / np.sqrt(3), (30, 1)))


def test_it_is_the_larger_of_the_local_and_the_overall_root_mean_square() -> None:
    rng = np.random.default_rng(0)
    speed, supported = rng.uniform(0, 1, 50) ** 3, rng.random(50) < 0.7
    found = typical_steps(chain(speed), supported)
    for step in range(50):
        near = [i for i in range(max(0, step - NEAR_STEPS), min(50, step + NEAR_STEPS + 1)) if supported[i]]
        local = np.mean(speed[near] ** 2) if near else 0.0
        expected = np.sqrt(max(local, np.mean(speed[supported] ** 2)) / 3)
        np.testing.assert_allclose(found[step], [expected / 2, expected], rtol=1e-9)


@pytest.mark.parametrize("count", [0, 1, 40])
def test_without_supported_steps_it_is_zero(count: int) -> None:
    found = typical_steps(chain(np.ones(count)), np.zeros(count, dtype=bool))
    np.testing.assert_array_equal(found, np.zeros((count, 2)))


def test_rounding_far_from_a_fast_stretch_is_not_taken_for_motion() -> None:
    speed, supported = np.full(300, 1e-3), np.arange(300) < 20
    speed[:10] = 7.0
    found = typical_steps(chain(speed), supported)
    overall = np.sqrt(np.mean(speed[:20] ** 2) / 3)
    np.testing.assert_allclose(found[60:, 1], overall)
