"""Landmarks in a recording: colours, error bars and labels."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.visualization.landmarks import colour_heights, compute_error_bars, label_landmarks
from tests.worlds import make_landmarks


def test_height_colours_run_from_blue_to_red_despite_outliers() -> None:
    count = 301
    z_m = np.append(np.linspace(-2, 1, 200), np.append(1e4, np.linspace(-90, 90, 100)))
    landmarks = replace(make_landmarks(count, 201), xyz_m=z_m[:, None] * [0, 0, 1])
    colours = colour_heights(landmarks).astype(int)
    assert colours[20, 2] > 2 * colours[20, 0] and colours[180, 0] > 2 * colours[180, 2]
    assert len(np.unique(colours[:200], axis=0)) > 100
    assert len(np.unique(colour_heights(make_landmarks(5, 5)), axis=0)) == 1
    assert [len(colour_heights(make_landmarks(found, 0))) for found in (4, 0)] == [4, 0]


def test_error_bars_follow_the_largest_standard_deviation() -> None:
    landmarks = make_landmarks(3, 2)
    turn = Rotation.from_rotvec([0.4, -0.2, 1.0])
    covariance_m2 = turn.as_matrix() @ np.diag([0.01, 0.09, 0.0004]) @ turn.as_matrix().T
    landmarks = replace(landmarks, xyz_m=np.arange(9.0).reshape(3, 3), covariance_m2=np.tile(covariance_m2, (3, 1, 1)))
    ends_m = compute_error_bars(landmarks, landmarks.well_constrained)
    np.testing.assert_allclose(ends_m.mean(axis=1), landmarks.xyz_m[:2])
    along = turn.inv().apply(ends_m[:, 1] - ends_m[:, 0])
    np.testing.assert_allclose(np.abs(along), [[0, 4 * 0.3, 0]] * 2, atol=1e-9)


def test_landmark_labels_state_views_and_sigma() -> None:
    landmarks = make_landmarks(3, 2)
    named = label_landmarks(landmarks, landmarks.well_constrained)
    assert named == ["track 0: 3 views, sigma 0.020 m", "track 1: 3 views, sigma 0.020 m"]
