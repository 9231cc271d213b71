"""Image warps: inverse maps, agreement of images with coordinates, and the border of the fan."""

import numpy as np
import pytest

from asfm.config import KeypointsConfig
from asfm.frontend.features.image_warp import (
    MAX_FAN_SIDE_PX,
    CartesianWarp,
    ImageWarp,
    StretchedPolarWarp,
    column_stretch,
    make_image_warp,
)
from asfm.geometry.sonar import SonarModel
from asfm.types import FloatArray

SHAPE = (240, 128)
EVEN = SonarModel.evenly_spaced("even", (1.0, 6.0), (-0.6, 0.6), SHAPE, 0.3)
UNEVEN = SonarModel("uneven", EVEN.range_m, 0.6 * np.sin(np.linspace(-1.2, 1.2, SHAPE[1])), 0.3)
SPACES = ["polar", "fan"]
each_warp = pytest.mark.parametrize(
    ("sonar", "space"), [(sonar, space) for sonar in (EVEN, UNEVEN) for space in SPACES], ids=lambda x: str(x)[:12]
)


def warp_of(sonar: SonarModel, space: str) -> ImageWarp:
    return make_image_warp(sonar, KeypointsConfig.model_validate({"space": space}))


def pixel_centres(shape: tuple[int, ...]) -> FloatArray:
    """(height * width, 2) column and row of the centres of an image's pixels, row by row."""
    row, column = np.indices(shape) + 0.5
    return np.stack([column.ravel(), row.ravel()], axis=1)


@each_warp
def test_from_polar_and_to_polar_are_inverse(sonar: SonarModel, space: str) -> None:
    warp = warp_of(sonar, space)
    row_column = np.random.default_rng(1).uniform((1, 1), np.array(SHAPE) - 1.0, (50, 2))
    np.testing.assert_allclose(warp.to_polar(warp.from_polar(row_column)), row_column, atol=1e-9)


@each_warp
def test_warped_images_agree_with_the_coordinates(sonar: SonarModel, space: str) -> None:
    """Images whose pixels hold their own row, or column, must show what ``to_polar`` returns."""
    warp = warp_of(sonar, space)
    own_row, own_column = (np.indices(SHAPE) + 0.5).astype(np.float32)
    warped = np.stack([warp.warp(own_row).ravel(), warp.warp(own_column).ravel()], axis=1)
    expected = warp.to_polar(pixel_centres(warp.warp(own_row).shape))
    inside = ((expected >= 0.5) & (expected <= np.array(SHAPE) - 0.5)).all(axis=1)
    assert inside.mean() > 0.3
    np.testing.assert_allclose(warped[inside], expected[inside], atol=0.05)  # OpenCV interpolates at 1/32 pixel


@each_warp
def test_a_warped_mask_agrees_with_the_coordinates(sonar: SonarModel, space: str) -> None:
    """Asymmetric along both axes, so that a mirrored mask fails."""
    warp, mask = warp_of(sonar, space), np.zeros(SHAPE, dtype=bool)
    mask[100:180, 20:50] = True
    warped = warp.warp_mask(mask)
    row, column = warp.to_polar(pixel_centres(warped.shape)).T
    inside = (row > 101) & (row < 179) & (column > 21) & (column < 49)
    outside = (row < 99) | (row > 181) | (column < 19) | (column > 51)
    assert warped.dtype == np.uint8 and inside.any() and outside.any()
    assert (warped.ravel()[inside] == 1).all() and not warped.ravel()[outside].any()


def test_the_fan_masks_everything_outside_and_has_no_border() -> None:
    fan, polar = warp_of(EVEN, "fan"), warp_of(EVEN, "polar")
    assert isinstance(fan, CartesianWarp) and isinstance(polar, StretchedPolarWarp)
    allowed = fan.warp_mask(np.ones(SHAPE, dtype=bool)) > 0
    np.testing.assert_array_equal(allowed, fan.grid.inside)
    assert fan.warp(np.ones(SHAPE, dtype=np.float32)).min() == 1.0
    assert fan.grid.pixel_m == pytest.approx(EVEN.range_step_m, rel=0.01)


def test_the_fan_of_a_fine_sonar_is_limited_in_size() -> None:
    fine = SonarModel.evenly_spaced("fine", (1.0, 6.0), (-0.6, 0.6), (6000, 16), 0.3)
    fan = warp_of(fine, "fan")
    assert isinstance(fan, CartesianWarp)
    assert max(fan.grid.shape) <= MAX_FAN_SIDE_PX < 2 * max(fan.grid.shape)


def test_stretched_pixels_are_square_at_the_middle_range() -> None:
    polar = warp_of(EVEN, "polar")
    assert isinstance(polar, StretchedPolarWarp)
    middle_m = 3.5
    column_m = middle_m * 1.2 / polar.width_px
    assert column_m == pytest.approx(EVEN.range_step_m, rel=0.01)
    assert column_stretch(EVEN, KeypointsConfig(max_stretch=1.2)) == 1.2


def test_warps_are_cached_for_each_sonar() -> None:
    assert warp_of(EVEN, "fan") is warp_of(EVEN, "fan")
    assert warp_of(EVEN, "fan") is not warp_of(UNEVEN, "fan")
