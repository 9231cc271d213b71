"""Detection inside a mask: only the part of the image around the mask is searched."""

import cv2
import numpy as np

from asfm.config import Config, KeypointsConfig
from asfm.frontend.features.keypoints import detect_keypoints
from asfm.geometry.sonar import SonarModel
from asfm.types import BoolArray, FloatArray, Frame

SHAPE = (600, 500)


def detect_row_column(mask: BoolArray) -> FloatArray:
    """Detect keypoints in blurred noise: (K, 2) rows and columns."""
    image = cv2.GaussianBlur(np.random.default_rng(1).random(SHAPE, np.float32), (0, 0), 2.0)
    sonar = SonarModel.evenly_spaced("test", (1.0, 6.0), (-0.5, 0.5), SHAPE, 0.3)
    frame = Frame(0, 0.0, (image - image.min()) / (image.max() - image.min()), np.zeros(SHAPE, dtype=bool))
    return detect_keypoints(frame, mask, sonar, Config(keypoints=KeypointsConfig(threshold=1e-4))).row_column


def test_keypoints_of_a_small_mask_are_those_of_the_whole_image() -> None:
    mask, corners = np.zeros(SHAPE, dtype=bool), np.zeros(SHAPE, dtype=bool)
    mask[280:330, 220:270] = True
    corners[20, 0] = corners[-20, -1] = True  # with them the detector searches the whole image
    found, expected = detect_row_column(mask), detect_row_column(mask | corners)
    assert len(found) > 10
    nearest_px = np.linalg.norm(found[:, None] - expected, axis=2).min(axis=1)
    assert np.median(nearest_px) < 0.1 and np.mean(nearest_px < 1) > 0.9
    assert len(found) > 0.8 * len(expected)


def test_an_empty_mask_has_no_keypoints() -> None:
    assert len(detect_row_column(np.zeros(SHAPE, dtype=bool))) == 0
