"""Image patches against a plain loop over a padded image."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from asfm.errors import AsfmError
from asfm.frontend.features.patches import crop_patches, cut_patches


@given(
    shape=st.tuples(st.integers(1, 30), st.integers(1, 30)),
    radius_px=st.integers(0, 12),
    count=st.integers(0, 9),
    seed=st.integers(0, 99),
)
def test_patches_are_those_of_a_reflected_image(shape: tuple[int, int], radius_px: int, count: int, seed: int) -> None:
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


@given(wide_px=st.integers(0, 9), narrow_px=st.integers(0, 12))
def test_cropped_patches_equal_patches_cut_with_the_smaller_radius(wide_px: int, narrow_px: int) -> None:
    rng = np.random.default_rng(0)
    image, row_column = rng.random((20, 30)).astype(np.float32), rng.random((6, 2)) * (20, 30)
    expected = cut_patches(image, row_column, min(wide_px, narrow_px))
    np.testing.assert_array_equal(crop_patches(cut_patches(image, row_column, wide_px), narrow_px), expected)


def test_patches_are_copies() -> None:
    image = np.zeros((5, 5), dtype=np.float32)
    cut_patches(image, np.array([[2.5, 2.5]]), 2)[:] = 1
    assert not image.any()


def test_invalid_input_is_an_error() -> None:
    image = np.zeros((5, 5), dtype=np.float32)
    with pytest.raises(AsfmError, match="row 1"):
        cut_patches(image, np.array([[1.0, 1.0], [np.nan, 2.0]]), 2)
    with pytest.raises(AsfmError, match="shape"):
        cut_patches(image[:0], np.zeros((1, 2)), 2)
