"""Fan image: inverse maps, resampling, orientation and size limits."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from asfm.errors import AsfmError
from asfm.geometry.fan import FanGrid
from asfm.geometry.sonar import SonarModel


def _sonar(
    near_m: float = 0.5,
    far_m: float = 8.0,
    half_deg: float = 35.0,
    shape: tuple[int, int] = (60, 40),
    bend: float = 0.0,
) -> SonarModel:
    """Make a sonar; its beams are denser in the middle for bend > 0."""
    even = np.linspace(-1, 1, shape[1])
    bearing_rad = np.deg2rad(half_deg) * ((1 - bend) * even + bend * even**3)
    return SonarModel("test", np.linspace(near_m, far_m, shape[0]), bearing_rad, np.deg2rad(12.0))


sonars = st.builds(
    _sonar,
    near_m=st.floats(0.0, 3.0),
    far_m=st.floats(4.0, 60.0),
    half_deg=st.floats(5.0, 170.0),
    bend=st.floats(0.0, 0.9),
)


@given(sonar=sonars, width_px=st.integers(8, 900), seed=st.integers(0, 99))
@settings(max_examples=60, deadline=None)
def test_pixel_at_and_range_bearing_at_are_inverse(sonar: SonarModel, width_px: int, seed: int) -> None:
    grid = FanGrid.fit(sonar, width_px)
    rng = np.random.default_rng(seed)
    range_m = rng.uniform(sonar.range_edges_m[0], sonar.range_edges_m[-1], 50)
    bearing_rad = rng.uniform(sonar.bearing_edges_rad[0], sonar.bearing_edges_rad[-1], 50)
    xy_px = grid.pixel_at(range_m, bearing_rad)
    assert (xy_px >= -1e-6).all() and (xy_px <= np.array([grid.width_px, grid.height_px]) + 1e-6).all()
    back_m, back_rad = grid.range_bearing_at(xy_px)
    np.testing.assert_allclose(back_m, range_m, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(back_rad[range_m > 1e-3], bearing_rad[range_m > 1e-3], atol=1e-6)


@given(sonar=sonars)
@settings(max_examples=20, deadline=None)
def test_fan_of_the_coordinates_is_the_inverse_map(sonar: SonarModel) -> None:
    """Images that hold the range, or the bearing, of their pixels must show the coordinates of the fan."""
    grid = FanGrid.fit(sonar, 120)
    columns, rows = np.meshgrid(np.arange(grid.width_px) + 0.5, np.arange(grid.height_px) + 0.5)
    range_m, bearing_rad = grid.range_bearing_at(np.stack([columns, rows], axis=-1))
    safe = (range_m > sonar.range_m[0]) & (range_m < sonar.range_m[-1])
    safe &= (bearing_rad > sonar.bearing_rad[0]) & (bearing_rad < sonar.bearing_rad[-1])
    every_range = np.repeat(sonar.range_m[:, None], sonar.shape[1], axis=1).astype(np.float32)
    every_bearing = np.repeat(sonar.bearing_rad[None], sonar.shape[0], axis=0).astype(np.float32)
    # OpenCV samples at 1/32 pixel.
    assert np.abs(grid.draw(every_range) - range_m)[safe].max() < np.diff(sonar.range_m).max() / 16
    assert np.abs(grid.draw(every_bearing) - bearing_rad)[safe].max() < np.diff(sonar.bearing_rad).max() / 16


@pytest.mark.parametrize("bend", [0.0, 0.8])
@pytest.mark.parametrize("near_m", [0.0, 2.0])
def test_a_bright_pixel_is_drawn_at_pixel_at(near_m: float, bend: float) -> None:
    sonar = _sonar(near_m=near_m, bend=bend)
    grid = FanGrid.fit(sonar, 700)
    for row, column in [(40, 8), (25, 33), (55, 20)]:
        image = np.zeros(sonar.shape, np.float32)
        image[row, column] = 1.0
        fan = grid.draw(image)
        expected = grid.pixel_at(sonar.range_m[row], sonar.bearing_rad[column])
        brightest = np.array(np.unravel_index(fan.argmax(), fan.shape))[::-1] + 0.5
        assert np.abs(brightest - expected).max() < 1.5


def test_port_is_left_and_ahead_is_up() -> None:
    sonar = _sonar()
    grid = FanGrid.fit(sonar, 200)
    image = np.zeros(sonar.shape, np.float32)
    image[:, sonar.bearing_rad > 0] = 1.0
    fan = grid.draw(image)
    assert fan[:, :98].sum() > 1000 and fan[:, 102:].max() < 0.05
    far = np.zeros(sonar.shape, np.float32)
    far[-20:] = 1.0
    rows = np.nonzero(grid.draw(far))[0]
    assert np.median(rows) < grid.height_px / 2
    np.testing.assert_allclose(grid.pixel_at(np.array(0.0), np.array(0.0)), [100.0, grid.height_px])


def test_one_sided_sonar_keeps_the_apex_in_the_middle() -> None:
    sonar = SonarModel("side", np.linspace(1.0, 9.0, 30), np.deg2rad(np.linspace(10.0, 60.0, 20)), 0.2)
    grid = FanGrid.fit(sonar, 300)
    assert grid.pixel_at(np.array(0.0), np.array(0.0))[0] == pytest.approx(150)
    assert not grid.inside[:, 150:].any() and grid.inside[:, :150].any()


def test_the_area_inside_is_that_of_an_annular_sector() -> None:
    sonar = _sonar(near_m=2.0, half_deg=120.0)
    grid = FanGrid.fit(sonar, 1000)
    near, far = sonar.range_edges_m[[0, -1]]
    opening = np.ptp(sonar.bearing_edges_rad)
    assert grid.inside.sum() * grid.pixel_m**2 == pytest.approx(0.5 * opening * (far**2 - near**2), rel=5e-3)


def test_pixels_outside_have_the_fill_value() -> None:
    sonar = _sonar()
    grid = FanGrid.fit(sonar, 150)
    fan = grid.draw(np.ones(sonar.shape, np.float32), fill=np.nan)
    np.testing.assert_array_equal(np.isnan(fan), ~grid.inside)
    assert (fan[grid.inside] == 1).all()


def test_the_type_of_the_image_is_kept() -> None:
    sonar = _sonar()
    grid = FanGrid.fit(sonar, 150)
    mask = np.zeros(sonar.shape, bool)
    mask[10:40, 5:20] = True
    fan = grid.draw(mask)
    assert fan.dtype == np.bool_ and fan.any() and not (fan & ~grid.inside).any()
    assert grid.draw(np.full(sonar.shape, 200, np.uint8)).max() == 200


@given(sonar=sonars, height_px=st.integers(20, 400))
@settings(max_examples=40, deadline=None)
def test_tall_fans_are_narrowed_to_the_maximum_height(sonar: SonarModel, height_px: int) -> None:
    free, grid = FanGrid.fit(sonar, 300), FanGrid.fit(sonar, 300, height_px)
    assert grid.height_px <= height_px or grid.width_px == 1
    assert grid.height_px + free.height_px / 300 + 1 >= min(height_px, free.height_px)
    if free.height_px <= height_px:
        assert grid.shape == free.shape


def test_invalid_sizes_and_shapes_are_an_error() -> None:
    with pytest.raises(AsfmError, match="at least 1 px, found 0"):
        FanGrid.fit(_sonar(), 0)
    with pytest.raises(AsfmError, match="ask for a width"):
        FanGrid.fit(_sonar(half_deg=0.5), 2000)
    with pytest.raises(AsfmError, match=r"expected \(60, 40\)"):
        FanGrid.fit(_sonar(), 50).draw(np.zeros((40, 60), np.float32))
