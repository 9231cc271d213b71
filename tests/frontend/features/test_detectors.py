"""Every detector in either picture: where blobs are, in the mask, upright or turned, and pictures that hold nothing."""

import cv2
import numpy as np
import pytest

from asfm.config import Config, KeypointsConfig
from asfm.frontend.features.detectors import DETECTORS
from asfm.frontend.features.image_warp import CartesianWarp, StretchedPolarWarp, make_image_warp
from asfm.frontend.features.keypoints import detect_keypoints
from asfm.frontend.features.subpixel import refine_subpixel
from asfm.geometry.sonar import SonarModel
from asfm.types import BoolArray, FloatArray, Frame, ImageArray, Keypoints

SHAPE = (240, 128)
SONAR = SonarModel.evenly_spaced("test", (1.0, 6.0), (-0.6, 0.6), SHAPE, 0.3)
EVERY = [(detector, space) for detector in DETECTORS for space in ("polar", "fan")]
every = pytest.mark.parametrize(("detector", "space"), EVERY)


def make_config(detector: str, space: str, **more: object) -> Config:
    return Config.model_validate({"keypoints": {"detector": detector, "space": space, **more}})


def detect(image: ImageArray, config: Config, mask: BoolArray | None = None) -> Keypoints:
    mask = np.ones(image.shape, dtype=bool) if mask is None else mask
    found = detect_keypoints(Frame(0, 0.0, image, np.zeros(image.shape, dtype=bool)), mask, SONAR, config)
    check(found, config)
    return found


def check(found: Keypoints, config: Config) -> None:
    """What the type promises, whatever is in the image."""
    length, kind = DETECTORS[config.keypoints.detector].descriptor
    assert found.descriptors.shape == (len(found), length) and found.descriptors.dtype == kind
    side = 2 * config.patch_radius_px + 1
    assert found.patches.shape == (len(found), side, side) and found.patches.dtype == np.float32
    assert len(found) <= config.keypoints.max_count and (np.diff(found.response) <= 0).all()
    for values in (found.row_column, found.range_m, found.bearing_rad, found.response, found.patches):
        assert np.isfinite(values).all()
    assert ((found.row_column >= 0) & (found.row_column <= SHAPE)).all()
    np.testing.assert_allclose(found.range_m, SONAR.range_at_row(found.row_column[:, 0]))
    np.testing.assert_allclose(found.bearing_rad, SONAR.bearing_at_column(found.row_column[:, 1]))


def draw_blocks(places: FloatArray, side_m: float = 0.35) -> ImageArray:
    """Draw squares of the ground plane, corner first, that blobs' and corners' detectors both find. (ranges, beams)."""
    x = SONAR.range_m[:, None] * np.cos(SONAR.bearing_rad)
    y = SONAR.range_m[:, None] * np.sin(SONAR.bearing_rad)
    image = np.zeros(SHAPE)
    for range_m, bearing_rad in places:
        dx, dy = x - range_m * np.cos(bearing_rad), y - range_m * np.sin(bearing_rad)
        image += np.maximum(np.abs(dx + dy), np.abs(dx - dy)) < side_m / 2 * np.sqrt(2)
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 1.0), dtype=np.float32)


def draw_debris() -> ImageArray:
    rng = np.random.default_rng(0)
    image = cv2.GaussianBlur(rng.random(SHAPE, np.float32), (0, 0), 2.0)
    return np.asarray((image - image.min()) / (image.max() - image.min()), dtype=np.float32)


PLACES = np.array([[2.6, -0.31], [3.4, 0.07], [4.1, 0.33], [4.6, -0.21]])


@every
def test_features_lie_about_what_is_there_without_bias(detector: str, space: str) -> None:
    """Mirrored or turned axes, half a pixel of a pyramid's level lost: all would show."""
    found = detect(draw_blocks(PLACES), make_config(detector, space))
    if detector == "brisk":
        assert len(found)  # it finds hardly anything in smooth pictures
        return
    x, y = found.range_m * np.cos(found.bearing_rad), found.range_m * np.sin(found.bearing_rad)
    px, py = PLACES[:, 0] * np.cos(PLACES[:, 1]), PLACES[:, 0] * np.sin(PLACES[:, 1])
    distance_m = np.hypot(x[:, None] - px, y[:, None] - py)
    assert np.median(distance_m.min(axis=1)) < 0.32, "little elsewhere"
    assert distance_m.min(axis=0).max() < 0.35, "nothing overlooked"


@every
def test_a_shift_of_the_image_shifts_features_by_as_much(detector: str, space: str) -> None:
    """Whole bins in range and, for the fan turns about the sonar then, whole beams in bearing."""
    image, config = draw_debris(), make_config(detector, space)
    image[:40] = image[-40:] = image[:, :30] = image[:, -30:] = 0
    shift = (8, 0) if space == "polar" else (0, 8)
    here, there = detect(image, config), detect(np.roll(image, shift, axis=(0, 1)), config)
    distance = np.abs(here.row_column[:, None] + shift - there.row_column).max(axis=2).min(axis=1)
    assert len(here) > 5 and np.median(distance) < (0.8 if detector == "brisk" else 0.3)


@every
def test_features_keep_to_the_mask(detector: str, space: str) -> None:
    mask = np.zeros(SHAPE, dtype=bool)
    mask[100:170, 40:90] = True
    everywhere = detect(draw_debris(), make_config(detector, space))
    inside = detect(draw_debris(), make_config(detector, space), mask)
    assert 0 < len(inside) < len(everywhere)
    grown = cv2.dilate(mask.astype(np.uint8), np.ones((7, 5), dtype=np.uint8)).astype(bool)
    row, column = np.floor(inside.row_column).astype(int).T
    assert grown[row, column].all(), "refinement moves a feature by a pixel or two of its level"


@every
@pytest.mark.parametrize("value", [0.0, 1e-40, 0.5, 1.0, 65535.0])
def test_an_even_image_has_no_features(detector: str, space: str, value: float) -> None:
    assert len(detect(np.full(SHAPE, value, dtype=np.float32), make_config(detector, space))) == 0


@every
def test_a_mask_that_covers_everything_leaves_nothing(detector: str, space: str) -> None:
    assert len(detect(draw_debris(), make_config(detector, space), np.zeros(SHAPE, dtype=bool))) == 0


@every
def test_sixteen_bits_are_as_good_as_a_float(detector: str, space: str) -> None:
    config, steps = make_config(detector, space), np.round(draw_debris() * 65535).astype(np.uint16)
    frames = (steps.astype(np.float32) / np.float32(65535), np.asarray(steps))
    first, second = (detect(np.asarray(image), config) for image in frames)
    assert len(first)
    near = np.abs(first.row_column[:, None] - second.row_column).max(axis=2).min(axis=1)
    assert (near < 0.1).mean() > 0.95


@every
def test_a_saturated_image_is_survived(detector: str, space: str) -> None:
    detect(np.minimum(4 * draw_debris(), 1).astype(np.float32), make_config(detector, space))


@every
def test_same_image_same_bytes_and_no_more_than_asked(detector: str, space: str) -> None:
    config = make_config(detector, space, max_count=20)
    first, second = detect(draw_debris(), config), detect(draw_debris(), config)
    assert 0 < len(first) <= 20
    for name in ("row_column", "response", "descriptors", "patches"):
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes()


@pytest.mark.parametrize("detector", ["akaze", "orb", "sift"])
def test_only_turned_descriptors_follow_a_turned_image(detector: str) -> None:
    """A vehicle that yaws by 32 degrees turns the fan: the same place is described alike if directions count."""

    image = draw_debris()
    image[:40] = image[-40:] = image[:, :40] = image[:, -40:] = 0

    def distance(upright: bool) -> float:
        config = make_config(detector, "fan", upright=upright)
        a, b = (detect(np.roll(image, shift, axis=1), config) for shift in (-30, 30))
        near = np.abs(a.row_column[:, None] + (0, 60) - b.row_column).max(axis=2)
        partner = near.argmin(axis=1)
        same = near.min(axis=1) < 1
        first, second = np.asarray(a.descriptors[same]), np.asarray(b.descriptors[partner[same]])
        if first.dtype == np.uint8:
            first, second = np.unpackbits(first, axis=1), np.unpackbits(second, axis=1)
        return float(np.median(np.linalg.norm(first.astype(float) - second.astype(float), axis=1)))

    assert distance(upright=False) < 0.9 * distance(upright=True)


@pytest.mark.parametrize("space", ["polar", "fan"])
def test_a_place_goes_to_the_picture_and_back(space: str) -> None:
    picture = make_image_warp(SONAR, KeypointsConfig.model_validate({"space": space}))
    row_column = np.random.default_rng(1).uniform((1, 1), np.array(SHAPE) - 1.0, (50, 2))
    np.testing.assert_allclose(picture.to_polar(picture.from_polar(row_column)), row_column, atol=1e-9)


def test_the_fan_allows_nothing_outside_and_has_no_outline() -> None:
    fan, polar = (
        make_image_warp(SONAR, KeypointsConfig.model_validate({"space": space})) for space in ("fan", "polar")
    )
    assert isinstance(fan, CartesianWarp) and isinstance(polar, StretchedPolarWarp)
    allowed = fan.warp_mask(np.ones(SHAPE, dtype=bool)) > 0
    np.testing.assert_array_equal(allowed, fan.grid.inside)
    assert fan.warp(np.ones(SHAPE, dtype=np.float32)).min() == 1.0
    assert fan.grid.pixel_m == pytest.approx(SONAR.range_step_m, rel=0.01)


@pytest.mark.parametrize("scale", [1.0, 1.2**3])
def test_a_corner_is_refined_to_a_fraction_of_a_pixel(scale: float) -> None:
    rng = np.random.default_rng(2)
    error = []
    for _ in range(20):
        where = np.asarray(rng.uniform(60, 68, 2), dtype=np.float64)
        row, column = np.indices((128, 128)) + 0.5
        squared = (column - where[0]) ** 2 + (row - where[1]) ** 2
        picture = (200 * np.exp(-squared / (2 * (3 * scale) ** 2))).astype(np.uint8)
        level = np.floor(where / scale) + rng.integers(-1, 2, 2)  # the number of a pixel, as OpenCV has it
        error.append(
            refine_subpixel(picture, np.asarray(level[None] * scale + 0.5, dtype=np.float64), np.array([scale]))[0]
            - where
        )
    assert np.abs(np.mean(error, axis=0)) == pytest.approx(0, abs=0.15)
    assert np.std(error, axis=0).max() < 0.25 * scale


def test_where_few_features_are_strong_the_strongest_weak_ones_fill_up() -> None:
    image = draw_debris()
    strong = detect(image, make_config("akaze", "polar", threshold=4e-3, min_count=0))
    filled = detect(image, make_config("akaze", "polar", threshold=4e-3, min_count=20))
    assert 0 < len(strong) < len(filled) == 20
    np.testing.assert_array_equal(filled.row_column[: len(strong)], strong.row_column)
    assert (strong.response >= 4e-3).all() and (filled.response[len(strong) :] < 4e-3).all()
    assert (filled.response >= 4e-3 / 5).all()
