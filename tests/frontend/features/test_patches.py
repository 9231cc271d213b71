"""Squares around keypoints against a plain loop over a padded image."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from asfm.errors import AsfmError
from asfm.frontend.features.patches import cut_patches


@given(
    shape=st.tuples(st.integers(1, 30), st.integers(1, 30)),
    radius_px=st.integers(0, 12),
    count=st.integers(0, 9),
    seed=st.integers(0, 99),
)
def test_patches_are_those_of_a_reflecting_image(shape: tuple[int, int], radius_px: int, count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    image = rng.random(shape).astype(np.float32)
    row_column = rng.random((count, 2)) * shape
    padded = np.pad(image, radius_px, mode="reflect")
    patches = cut_patches(image, row_column, radius_px)
    assert patches.shape == (count, 2 * radius_px + 1, 2 * radius_px + 1)
    assert patches.dtype == np.float32
    for (row, column), patch in zip(row_column.astype(int), patches, strict=True):
        width = 2 * radius_px + 1
        np.testing.assert_array_equal(patch, padded[row : row + width, column : column + width])


def test_pixel_i_spans_i_to_i_plus_1() -> None:
    image = np.arange(12, dtype=np.float32).reshape(3, 4)
    centres = np.array([[1.0, 2.0], [1.5, 2.5], [1.999, 2.999], [3.0, 4.0], [-5.0, 99.0]])
    np.testing.assert_array_equal(cut_patches(image, centres, 0).ravel(), [6, 6, 6, 11, 3])


def test_the_image_is_not_shared_with_the_patches() -> None:
    image = np.zeros((5, 5), dtype=np.float32)
    cut_patches(image, np.array([[2.5, 2.5]]), 2)[:] = 1
    assert not image.any()


def test_bad_input_is_refused_with_one_clear_line() -> None:
    image = np.zeros((5, 5), dtype=np.float32)
    with pytest.raises(AsfmError, match="row 1"):
        cut_patches(image, np.array([[1.0, 1.0], [np.nan, 2.0]]), 2)
    with pytest.raises(AsfmError, match="shape"):
        cut_patches(image[:0], np.zeros((1, 2)), 2)
