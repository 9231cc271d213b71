"""Reference-cell sums and counts against a plain double loop over the window of every pixel."""

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from asfm.frontend.denoising.cfar_windows import (
    as_counts,
    clip_half,
    count_leading_lagging,
    count_reference_cells,
    count_ring_below,
    sum_leading_lagging,
    sum_reference_cells,
)
from asfm.types import BoolArray, FloatArray

HalfSize = tuple[int, int]
shapes = st.tuples(st.integers(1, 14), st.integers(1, 14))
guards = st.tuples(st.integers(0, 4), st.integers(0, 4))
margins = st.tuples(st.integers(0, 18), st.integers(0, 18))
seeds = st.integers(0, 99)


def reference_cells(shape: HalfSize, cell: HalfSize, reference_px: HalfSize, guard_px: HalfSize) -> Iterator[HalfSize]:
    """Yield the reference cells of one cell under test."""
    for row in range(cell[0] - reference_px[0], cell[0] + reference_px[0] + 1):
        for column in range(cell[1] - reference_px[1], cell[1] + reference_px[1] + 1):
            guarded = abs(row - cell[0]) <= guard_px[0] and abs(column - cell[1]) <= guard_px[1]
            if not guarded and 0 <= row < shape[0] and 0 <= column < shape[1]:
                yield row, column


def plain_sums(
    image: FloatArray, reference_px: HalfSize, guard_px: HalfSize
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Sum over all, the leading and the lagging reference cells of each pixel."""
    total, leading, lagging = (np.zeros(image.shape) for _ in range(3))
    for cell in np.ndindex(*image.shape):
        for row, column in reference_cells((len(image), len(image[0])), (cell[0], cell[1]), reference_px, guard_px):
            total[cell] += image[row, column]
            leading[cell] += image[row, column] * (row < cell[0])
            lagging[cell] += image[row, column] * (row > cell[0])
    return total, leading, lagging


@settings(deadline=None, max_examples=60)
@given(shape=shapes, guard_px=guards, margin_px=margins, seed=seeds)
def test_sums_are_those_of_a_plain_loop(shape: HalfSize, guard_px: HalfSize, margin_px: HalfSize, seed: int) -> None:
    reference_px = (guard_px[0] + margin_px[0], guard_px[1] + margin_px[1])
    image = np.random.default_rng(seed).random(shape).astype(np.float32)
    total, leading, lagging = plain_sums(image.astype(float), reference_px, guard_px)
    found = sum_reference_cells(image, reference_px, guard_px)
    assert found.dtype == np.float64
    np.testing.assert_allclose(found, total, atol=1e-12)
    halves = sum_leading_lagging(image, reference_px, guard_px)
    np.testing.assert_allclose(halves[0], leading, atol=1e-12)
    np.testing.assert_allclose(halves[1], lagging, atol=1e-12)


@settings(deadline=None, max_examples=60)
@given(shape=shapes, guard_px=guards, margin_px=margins, share=st.sampled_from([0.0, 0.3, 0.9, 1.0]), seed=seeds)
def test_counts_are_those_of_a_plain_loop(
    shape: HalfSize, guard_px: HalfSize, margin_px: HalfSize, share: float, seed: int
) -> None:
    """A share of 1 takes the closed form."""
    reference_px = (guard_px[0] + margin_px[0], guard_px[1] + margin_px[1])
    mask = np.asarray(np.random.default_rng(seed).random(shape) < share)
    total, leading, lagging = plain_sums(mask.astype(float), reference_px, guard_px)
    np.testing.assert_array_equal(count_reference_cells(mask, reference_px, guard_px), total)
    halves = count_leading_lagging(mask, reference_px, guard_px)
    np.testing.assert_array_equal(halves[0], leading)
    np.testing.assert_array_equal(halves[1], lagging)


@settings(deadline=None, max_examples=60)
@given(shape=shapes, guard_px=guards, margin_px=margins, seed=seeds)
def test_cells_below_a_limit_are_those_of_a_plain_loop(
    shape: HalfSize, guard_px: HalfSize, margin_px: HalfSize, seed: int
) -> None:
    """Few distinct values, so that equality with the limit occurs, and infinite ones, which must not count."""
    reference_px = (guard_px[0] + margin_px[0], guard_px[1] + margin_px[1])
    rng = np.random.default_rng(seed)
    image = rng.choice([0.0, 1.0, 2.0, np.inf], shape).astype(np.float32)
    limit = rng.choice([0.5, 1.0, 2.0, np.inf], shape).astype(np.float32)
    expected = np.zeros(shape, dtype=int)
    for cell in np.ndindex(*shape):
        cells = reference_cells(shape, (cell[0], cell[1]), reference_px, guard_px)
        expected[cell] = sum(image[index] < limit[cell] for index in cells)
    np.testing.assert_array_equal(count_ring_below(image, limit, reference_px, guard_px), expected)


def test_blocks_of_rows_and_more_than_255_cells_are_counted_in_full() -> None:
    """Blocks hold 2^15 pixels, and bytes count 255 offsets at a time."""
    image, limit = np.zeros((300, 300), dtype=np.float32), np.ones((300, 300), dtype=np.float32)
    expected = count_reference_cells(np.ones((300, 300), dtype=bool), (9, 16), (1, 2))
    assert expected.max() == 19 * 33 - 3 * 5
    np.testing.assert_array_equal(count_ring_below(image, limit, (9, 16), (1, 2)), expected)


@pytest.mark.parametrize(("half_px", "clipped"), [((3, 4), (3, 4)), ((99, 4), (9, 4)), ((3, 99), (3, 19))])
def test_half_sizes_are_clipped_to_the_image(half_px: HalfSize, clipped: HalfSize) -> None:
    assert clip_half(half_px, (10, 20)) == clipped


@pytest.mark.parametrize("step", [1, 2])
def test_masks_are_viewed_as_zeros_and_ones(step: int) -> None:
    mask: BoolArray = np.random.default_rng(0).random((12, 13))[:, ::step] < 0.5
    counts: NDArray[np.uint8] = as_counts(mask)
    assert counts.dtype == np.uint8
    np.testing.assert_array_equal(counts, np.where(mask, 1, 0))
