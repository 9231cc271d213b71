"""DBSCAN on the pixel grid against scikit-learn's."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from asfm.config import ClustersConfig
from asfm.errors import AsfmError
from asfm.frontend.clusters import keep_clusters
from asfm.types import BoolArray, IntArray
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.cluster import DBSCAN


def dbscan(mask: BoolArray, config: ClustersConfig) -> IntArray:
    """scikit-learn's labels as an image: -1 for noise and for what is not detected."""
    labels = np.full(mask.shape, -1)
    if mask.any():
        model = DBSCAN(eps=config.radius_px, min_samples=config.min_pixels)
        labels[mask] = model.fit(np.argwhere(mask)).labels_
    return labels


@settings(deadline=None, max_examples=150)
@given(
    shape=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    share=st.sampled_from([0.0, 0.02, 0.1, 0.3, 0.6, 1.0]),
    radius_px=st.sampled_from([0.5, 1.0, 1.2, 2**0.5, 2.0, 5**0.5, 13**0.5, 3.0, 4.5, 5.0, 60.0]),
    min_pixels=st.integers(1, 14),
    seed=st.integers(0, 9),
)
def test_noise_of_random_masks_is_that_of_scikit_learn(
    shape: tuple[int, int], share: float, radius_px: float, min_pixels: int, seed: int
) -> None:
    mask = np.random.default_rng(seed).random(shape) < share
    config = ClustersConfig(radius_px=radius_px, min_pixels=min_pixels)
    np.testing.assert_array_equal(keep_clusters(mask, config), dbscan(mask, config) >= 0)


def test_noise_of_real_frames_is_that_of_scikit_learn(shared_data: Path) -> None:
    for path in sorted((shared_data / "didson_hull" / "hull").glob("*.png")):
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        assert image is not None
        mask = image > np.quantile(image, 0.9)
        for config in (ClustersConfig(), ClustersConfig(radius_px=2, min_pixels=7)):
            kept = keep_clusters(mask, config)
            assert 0 < kept.sum() < mask.sum()
            np.testing.assert_array_equal(kept, dbscan(mask, config) >= 0)


def test_input_is_left_alone_and_a_view_will_do() -> None:
    mask = np.random.default_rng(0).random((40, 60)) < 0.2
    before = mask.copy()
    turned = keep_clusters(mask.T, ClustersConfig())
    np.testing.assert_array_equal(turned, keep_clusters(np.ascontiguousarray(mask.T), ClustersConfig()))
    np.testing.assert_array_equal(mask, before)


def test_a_mask_of_another_rank_is_refused() -> None:
    with pytest.raises(AsfmError, match="shape"):
        keep_clusters(np.zeros(5, dtype=bool), ClustersConfig())
