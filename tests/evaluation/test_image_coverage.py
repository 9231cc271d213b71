"""Coverage of the image by keypoints and matches."""

from dataclasses import replace

import numpy as np
import pytest

from asfm.evaluation.image_coverage import GRID, measure_coverage
from tests.evaluation.test_matching import SONAR, keypoints_at, matches_of, same


def test_a_keypoint_in_each_cell_covers_all_and_one_cell_counts_once() -> None:
    step = np.array(SONAR.shape) / GRID
    centre = (np.indices(GRID).reshape(2, -1).T + 0.5) * step
    everywhere = replace(keypoints_at(np.ones(len(centre)), np.zeros(len(centre))), row_column=centre)
    crowd = replace(everywhere, row_column=np.full_like(centre, 0.1))
    found = measure_coverage([everywhere], [], SONAR)
    assert found is not None and (found.keypoints, found.matches) == (1.0, 0.0)
    found = measure_coverage([crowd, crowd], [matches_of(same(9))], SONAR)
    assert found is not None and found.keypoints == found.matches == pytest.approx(1 / 256)


def test_matches_of_either_frame_count_and_the_edge_lies_in_the_last_cell() -> None:
    corner = replace(keypoints_at(np.ones(2), np.zeros(2)), row_column=np.array([[0.0, 0.0], SONAR.shape]))
    nothing = keypoints_at(np.zeros(0), np.zeros(0))
    found = measure_coverage([corner, corner, nothing], [matches_of([(0, 1)], 0, 1)], SONAR)
    assert found is not None
    assert found.keypoints == pytest.approx(4 / 256 / 3) and found.matches == pytest.approx(2 / 256 / 3)


def test_no_frames_have_no_coverage() -> None:
    assert measure_coverage([], [], SONAR) is None
