"""Sub-pixel refinement against corners and blobs at known positions."""

import numpy as np
import pytest
from numpy.typing import NDArray

from asfm.frontend.features.subpixel import MIN_LEVEL_SIDE_PX, _parabola_maximum, refine_subpixel
from asfm.types import FloatArray

SHAPE = (120, 140)
SCALES = [1.0, 1.2**2, 1.2**5]


def draw_blob(xy_px: FloatArray, sigma_px: float) -> NDArray[np.uint8]:
    row, column = np.indices(SHAPE) + 0.5
    squared = (column - xy_px[0]) ** 2 + (row - xy_px[1]) ** 2
    return np.asarray(np.round(200 * np.exp(-squared / (2 * sigma_px**2))), dtype=np.uint8)


def refine(image: NDArray[np.uint8], index: FloatArray, scale: float) -> FloatArray:
    """Refine (K, 2) pixel indices on the level of a scale, positioned in the image as OpenCV does."""
    return refine_subpixel(image, np.asarray(index * scale + 0.5, dtype=np.float64), np.full(len(index), scale))


@pytest.mark.parametrize("scale", [1.0, 1.2**3])
def test_blobs_are_found_to_a_fraction_of_a_pixel(scale: float) -> None:
    rng, error = np.random.default_rng(2), []
    for _ in range(20):
        xy_px = rng.uniform(60, 68, 2)
        index = np.floor(xy_px / scale) + rng.integers(-1, 2, 2)
        error.append(refine(draw_blob(xy_px, 3 * scale), np.asarray(index[None], dtype=float), scale)[0] - xy_px)
    assert np.abs(np.mean(error, axis=0)) == pytest.approx(0, abs=0.15)
    assert np.std(error, axis=0).max() < 0.25 * scale


@pytest.mark.parametrize("scale", SCALES)
def test_refinement_is_limited_to_the_neighbouring_pixels_of_the_level(scale: float) -> None:
    """1.5 pixels; on rounded levels up to 0.5 more, from the corner to the centre of the pixel it is in."""
    rng = np.random.default_rng(3)
    image = rng.integers(0, 255, SHAPE).astype(np.uint8)
    index = rng.uniform(10, 0.7 * np.array(SHAPE[::-1]) / scale, (200, 2)).astype(int).astype(float)
    corrected = (index + 0.5) * scale
    moved = np.abs(refine(image, index, scale) - corrected) / scale
    assert 1.0 < moved.max() <= (1.5 if scale == 1 else 2.0) * 1.001


def test_the_order_and_the_input_are_kept() -> None:
    rng = np.random.default_rng(4)
    image = rng.integers(0, 255, SHAPE).astype(np.uint8)
    xy_px, scale = rng.uniform(20, 100, (60, 2)), rng.choice(SCALES, 60)
    before = xy_px.copy()
    together = refine_subpixel(image, xy_px, scale)
    np.testing.assert_array_equal(xy_px, before)
    alone = [refine_subpixel(image, xy_px[i : i + 1], scale[i : i + 1])[0] for i in range(60)]
    np.testing.assert_array_equal(together, alone)


def test_corners_at_the_border_and_on_tiny_levels_stay_in_the_image() -> None:
    image = np.random.default_rng(5).integers(0, 255, SHAPE).astype(np.uint8)
    corners = np.array([[0.5, 0.5], [139.5, 0.5], [0.5, 119.5], [139.5, 119.5]])
    refined = refine_subpixel(image, corners, np.ones(4))
    assert ((refined >= 0) & (refined <= SHAPE[::-1])).all()
    tiny = SHAPE[0] / (MIN_LEVEL_SIDE_PX - 1)
    np.testing.assert_allclose(refine_subpixel(image, corners, np.full(4, tiny)), corners + (tiny - 1) / 2)
    assert refine_subpixel(image, np.zeros((0, 2)), np.zeros(0)).shape == (0, 2)


def test_parabola_maximum_against_known_parabolas() -> None:
    offset = np.linspace(-0.5, 0.5, 11)
    before, here, after = (np.asarray(5 - 3 * (x - offset) ** 2, dtype=np.float32) for x in (-1, 0, 1))
    np.testing.assert_allclose(_parabola_maximum(before, here, after), offset, atol=1e-6)
    flat, valley = np.ones(1, dtype=np.float32), np.full(1, 2.0, dtype=np.float32)
    assert _parabola_maximum(flat, flat, flat) == 0 and _parabola_maximum(valley, flat, valley) == 0
    assert _parabola_maximum(flat * 0, flat, flat * 1.9) == 0.5, "a maximum farther away is clipped"
