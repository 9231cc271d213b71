"""XFeat on simulated images with known motion."""

import numpy as np
import pytest

from asfm.learned.xfeat import MIN_SIMILARITY, match_images, match_mutually
from tests.learned.simulated_pair import check_matcher, check_nothing_to_match, needs_extra


@needs_extra
@pytest.mark.parametrize("with_sonar", [True, False])
def test_most_matches_agree_with_the_motion(with_sonar: bool) -> None:
    check_matcher(match_images, with_sonar)


@needs_extra
def test_an_image_without_echoes_has_no_matches() -> None:
    check_nothing_to_match(match_images)


def test_mutual_nearest_neighbours_equal_a_plain_search() -> None:
    rng = np.random.default_rng(0)
    first = rng.normal(size=(40, 3))
    second = np.concatenate([first[::-1] + rng.normal(0, 0.1, first.shape), rng.normal(size=(9, 3))])
    a, b = ((rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32) for rows in (first, second))
    expected = []
    for i, row in enumerate(a):
        j = max(range(len(b)), key=lambda column: float(row @ b[column]))
        back = max(range(len(a)), key=lambda index: float(a[index] @ b[j]))
        if back == i and row @ b[j] > MIN_SIMILARITY:
            expected.append([i, j])
    assert 5 < len(expected) < 40
    assert match_mutually(a, b).tolist() == expected


def test_dissimilar_descriptors_do_not_match() -> None:
    axes = np.eye(4, dtype=np.float32)
    assert match_mutually(axes[:2], axes[2:]).shape == (0, 2)
