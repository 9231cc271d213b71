"""DBSCAN on the pixel grid against scikit-learn's."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from sklearn.cluster import DBSCAN

from asfm.config import DbscanConfig
from asfm.errors import AsfmError
from asfm.frontend.denoising.dbscan import dbscan_labels, dbscan_mask
from asfm.types import BoolArray, IntArray


def dbscan(mask: BoolArray, config: DbscanConfig) -> IntArray:
    """Return scikit-learn's labels as an image: -1 for noise and where nothing is detected."""
    labels = np.full(mask.shape, -1)
    if mask.any():
        model = DBSCAN(eps=config.radius_px, min_samples=config.min_pixels)
        labels[mask] = model.fit(np.argwhere(mask)).labels_
    return labels


@settings(deadline=None, max_examples=150)
@given(
    shape=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    share=st.sampled_from([0.0, 0.02, 0.1, 0.3, 0.6, 1.0]),
    radius_px=st.sampled_from([0.5, 1.0, 1.2, 2**0.5, 1.9, 2.0, 5**0.5, 3.0, 13**0.5, 4.5, 5.0, 60.0]),
    min_pixels=st.integers(1, 14),
    seed=st.integers(0, 9),
)
@example(shape=(30, 30), share=0.3, radius_px=1.2, min_pixels=2, seed=0)
def test_labels_of_random_masks_are_those_of_scikit_learn(
    shape: tuple[int, int], share: float, radius_px: float, min_pixels: int, seed: int
) -> None:
    mask = np.random.default_rng(seed).random(shape) < share
    config = DbscanConfig(radius_px=radius_px, min_pixels=min_pixels)
    expected = dbscan(mask, config)
    np.testing.assert_array_equal(dbscan_mask(mask, config), expected >= 0)
    np.testing.assert_array_equal(dbscan_labels(mask, config), expected)


def test_labels_of_real_frames_are_those_of_scikit_learn(shared_data: Path) -> None:
    paths = sorted((shared_data / "didson_hull" / "hull").glob("*.png"))
    assert paths
    for path in paths:
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        assert image is not None
        mask = image > np.quantile(image, 0.9)
        for config in (DbscanConfig(radius_px=3, min_pixels=10), DbscanConfig(radius_px=2, min_pixels=7)):
            kept = dbscan_mask(mask, config)
            assert 0 < kept.sum() < mask.sum()
            expected = dbscan(mask, config)
            np.testing.assert_array_equal(kept, expected >= 0)
            np.testing.assert_array_equal(dbscan_labels(mask, config), expected)


def test_the_mask_may_be_a_view_and_is_not_modified() -> None:
    mask = np.random.default_rng(0).random((40, 60)) < 0.2
    before, config = mask.copy(), DbscanConfig(radius_px=3, min_pixels=6)
    copy = np.ascontiguousarray(mask.T)
    np.testing.assert_array_equal(dbscan_mask(mask.T, config), dbscan_mask(copy, config))
    np.testing.assert_array_equal(dbscan_labels(mask.T, config), dbscan_labels(copy, config))
    np.testing.assert_array_equal(mask, before)


def test_clusters_join_across_gaps_of_the_radius_but_not_wider_ones() -> None:
    mask = np.zeros((9, 30), dtype=bool)
    mask[4, 2:8] = mask[4, 10:16] = mask[4, 18:24] = True
    labels = dbscan_labels(mask, DbscanConfig(radius_px=3.0, min_pixels=2))
    assert set(labels[mask].tolist()) == {0}
    labels = dbscan_labels(mask, DbscanConfig(radius_px=2.9, min_pixels=2))
    assert [set(labels[4, part].tolist()) for part in (slice(2, 8), slice(10, 16), slice(18, 24))] == [{0}, {1}, {2}]


@pytest.mark.parametrize("shape", [(0, 0), (0, 7), (1, 1), (50, 40)])
@pytest.mark.parametrize("full", [False, True])
def test_empty_and_full_masks(shape: tuple[int, int], full: bool) -> None:
    mask, config = np.full(shape, full), DbscanConfig(radius_px=3, min_pixels=1)
    np.testing.assert_array_equal(dbscan_mask(mask, config), mask)
    np.testing.assert_array_equal(dbscan_labels(mask, config), mask.astype(int) - 1)


@pytest.mark.parametrize("stage", [dbscan_mask, dbscan_labels])
def test_a_mask_that_is_not_two_dimensional_is_an_error(stage: Callable[[BoolArray, DbscanConfig], object]) -> None:
    with pytest.raises(AsfmError, match="shape"):
        stage(np.zeros(5, dtype=bool), DbscanConfig())


def test_more_clusters_than_16_bits_can_number() -> None:
    mask = np.ones((300, 300), dtype=bool)
    labels = dbscan_labels(mask, DbscanConfig(radius_px=0.5, min_pixels=1))
    np.testing.assert_array_equal(labels.ravel(), np.arange(mask.size))


def test_a_long_chain_of_components_is_one_cluster() -> None:
    """Dots on a spiral, three pixels apart: no two are adjacent, and their labels are joined in no particular order."""
    mask = np.zeros((61, 61), dtype=bool)
    row, column, ahead = 30, 30, (0, 3)
    for length in range(1, 20):
        for _ in range(length // 2 + 1):
            mask[row, column] = True
            row, column = row + ahead[0], column + ahead[1]
        ahead = (ahead[1], -ahead[0])
    config = DbscanConfig(radius_px=3.0, min_pixels=2)
    assert set(dbscan_labels(mask, config)[mask].tolist()) == {0}
    np.testing.assert_array_equal(dbscan_labels(mask, config), dbscan(mask, config))
