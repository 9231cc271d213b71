"""Feature noise from matches: the simulated noise is found under motion, wrong matches and elevations."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.frontend.matching.match_noise import MIN_INLIERS, MIN_PAIRS, estimate_match_noise
from asfm.geometry.poses import make_pose, transform
from asfm.geometry.sonar import back_project, project
from asfm.types import FloatArray, Keypoints, Matches
from tests.worlds import make_keypoints

Pair = tuple[Keypoints, Keypoints, Matches]
SIGMA = np.array([0.012, 0.006])
QUIET, ROLLING = 0.002, 0.05
"""Roll and pitch between two frames, rad."""


def make_pair(
    seed: int, tilt_rad: float = QUIET, wrong: float = 0.0, count: int = 120, noise: FloatArray = SIGMA
) -> Pair:
    """Match points in the beam in two frames, of which a share is matched at random."""
    rng = np.random.default_rng(seed)
    points_m = back_project(rng.uniform(2, 9, count), rng.uniform(-0.6, 0.6, count), rng.uniform(-0.1, 0.1, count))
    tilt = Rotation.from_euler("xyz", [tilt_rad, -tilt_rad, rng.uniform(-0.1, 0.1)])
    motion = make_pose(np.append(rng.uniform(-0.1, 0.1, 2), 0.01), tilt)
    seen = []
    for xyz_m in (points_m, transform(motion, points_m)):
        range_m, bearing_rad, _ = project(xyz_m)
        seen.append(
            make_keypoints(range_m + rng.normal(0, noise[0], count), bearing_rad + rng.normal(0, noise[1], count))
        )
    partner = np.arange(count)
    swapped = rng.permutation(count)[: round(wrong * count)]
    partner[swapped] = rng.permutation(swapped)
    return seen[0], seen[1], Matches(0, 1, np.stack([np.arange(count), partner], axis=1), np.full(count, 0.5))


@pytest.mark.parametrize("scale", [0.25, 1.0, 4.0])
@pytest.mark.parametrize("wrong", [0.0, 0.3])
def test_the_noise_is_found(scale: float, wrong: float) -> None:
    """Half the pairs roll and pitch: the others tell. Wrong matches near the right place widen the spread a little."""
    tilts = [QUIET, ROLLING] * 6
    pairs = [make_pair(seed, tilt, wrong, noise=scale * SIGMA) for seed, tilt in enumerate(tilts)]
    found = estimate_match_noise(pairs)
    assert found is not None
    np.testing.assert_allclose(found, scale * SIGMA, rtol=0.2 if not wrong else 0.35)


def test_each_axis_has_its_own_noise() -> None:
    one, other = (
        estimate_match_noise([make_pair(seed, noise=SIGMA * factor) for seed in range(8)])
        for factor in ([1.0, 1.0], [3.0, 1.0])
    )
    assert one is not None and other is not None
    assert 2.6 < other[0] / one[0] < 3.4
    assert 0.9 < other[1] / one[1] < 1.1


def test_few_matches_or_few_pairs_tell_nothing() -> None:
    assert estimate_match_noise([make_pair(seed) for seed in range(MIN_PAIRS - 1)]) is None
    assert estimate_match_noise([make_pair(seed, count=MIN_INLIERS - 1) for seed in range(8)]) is None
    assert estimate_match_noise([]) is None


def test_matches_that_agree_on_no_motion_tell_nothing() -> None:
    assert estimate_match_noise([make_pair(seed, wrong=1.0) for seed in range(8)]) is None


def test_exact_positions_have_no_noise() -> None:
    found = estimate_match_noise([make_pair(seed, tilt_rad=0.0, noise=np.zeros(2)) for seed in range(4)])
    assert found is not None
    assert (found < 0.1 * SIGMA).all()
