"""Every detector in either warped image: position bias, mask, orientation, saturation, and images without features."""

import cv2
import numpy as np
import pytest

from asfm.config import Config
from asfm.frontend.features.detectors import DETECTORS
from asfm.frontend.features.keypoints import detect_keypoints
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
    """Check shapes, types, order and ranges, which hold for any image."""
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
    """Draw squares of the ground plane, standing on a corner, which blob and corner detectors find: (ranges, beams)."""
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


BLOCKS = np.array([[2.6, -0.31], [3.4, 0.07], [4.1, 0.33], [4.6, -0.21]])
"""(N, 2) range_m and bearing_rad."""


@every
def test_features_are_at_the_blocks(detector: str, space: str) -> None:
    """Mirrored or rotated axes and a lost half pixel of a pyramid level would fail."""
    found = detect(draw_blocks(BLOCKS), make_config(detector, space))
    if detector == "brisk":
        assert len(found)  # it finds hardly anything in smooth images
        return
    x, y = found.range_m * np.cos(found.bearing_rad), found.range_m * np.sin(found.bearing_rad)
    px, py = BLOCKS[:, 0] * np.cos(BLOCKS[:, 1]), BLOCKS[:, 0] * np.sin(BLOCKS[:, 1])
    distance_m = np.hypot(x[:, None] - px, y[:, None] - py)
    assert np.median(distance_m.min(axis=1)) < 0.32, "most features belong to a block"
    assert distance_m.min(axis=0).max() < 0.35, "every block has a feature"


@every
def test_features_shift_with_the_image(detector: str, space: str) -> None:
    """By whole range bins in the polar image, and by whole beams, a rotation about the sonar, in the fan."""
    image, config = draw_debris(), make_config(detector, space)
    image[:40] = image[-40:] = image[:, :30] = image[:, -30:] = 0
    shift = (8, 0) if space == "polar" else (0, 8)
    here, there = detect(image, config), detect(np.roll(image, shift, axis=(0, 1)), config)
    distance = np.abs(here.row_column[:, None] + shift - there.row_column).max(axis=2).min(axis=1)
    assert len(here) > 5 and np.median(distance) < (0.8 if detector == "brisk" else 0.3)


@every
def test_features_are_inside_the_mask(detector: str, space: str) -> None:
    mask = np.zeros(SHAPE, dtype=bool)
    mask[100:170, 40:90] = True
    everywhere = detect(draw_debris(), make_config(detector, space))
    inside = detect(draw_debris(), make_config(detector, space), mask)
    assert 0 < len(inside) < len(everywhere)
    grown = cv2.dilate(mask.astype(np.uint8), np.ones((7, 5), dtype=np.uint8)).astype(bool)
    row, column = np.floor(inside.row_column).astype(int).T
    assert grown[row, column].all(), "only refinement may move a feature out, by a pixel or two of its level"


@every
@pytest.mark.parametrize("value", [0.0, 1e-40, 0.5, 1.0, 65535.0])
def test_a_uniform_image_has_no_features(detector: str, space: str, value: float) -> None:
    assert len(detect(np.full(SHAPE, value, dtype=np.float32), make_config(detector, space))) == 0


@every
def test_an_empty_mask_has_no_features(detector: str, space: str) -> None:
    assert len(detect(draw_debris(), make_config(detector, space), np.zeros(SHAPE, dtype=bool))) == 0


@every
def test_features_of_16_bit_and_float_images_agree(detector: str, space: str) -> None:
    config, levels = make_config(detector, space), np.round(draw_debris() * 65535).astype(np.uint16)
    images = (levels.astype(np.float32) / np.float32(65535), np.asarray(levels))
    first, second = (detect(np.asarray(image), config) for image in images)
    assert len(first)
    near = np.abs(first.row_column[:, None] - second.row_column).max(axis=2).min(axis=1)
    assert (near < 0.1).mean() > 0.95


@every
def test_saturation_adds_no_features_on_plateaus_and_moves_few(detector: str, space: str) -> None:
    """6 % and 94 % of the pixels are saturated, the latter in plateaus of up to 24 pixels from rim to centre."""
    image, config = draw_debris(), make_config(detector, space)
    few, many = (np.minimum(gain * image, 1).astype(np.float32) for gain in (1.6, 4.0))
    before, after = detect(image, config), detect(few, config)
    shift_px = np.abs(after.row_column[:, None] - before.row_column).max(axis=2).min(axis=1)
    assert len(after) > 0.7 * len(before) and (shift_px < 1.5).mean() > 0.75
    found = detect(many, config)
    row, column = np.minimum(np.floor(found.row_column).astype(int), np.array(SHAPE) - 1).T
    from_rim_px = cv2.distanceTransform((many >= 1).astype(np.uint8), cv2.DIST_L2, 5)
    assert from_rim_px.max() > 20 and len(found) and from_rim_px[row, column].max() < 6


@every
def test_detection_is_deterministic_and_limited_to_max_count(detector: str, space: str) -> None:
    config = make_config(detector, space, max_count=20)
    first, second = detect(draw_debris(), config), detect(draw_debris(), config)
    assert 0 < len(first) <= 20
    for name in ("row_column", "response", "descriptors", "patches"):
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes()


@pytest.mark.parametrize("detector", ["akaze", "orb", "sift"])
def test_only_oriented_descriptors_are_invariant_to_rotation(detector: str) -> None:
    """A yaw of the vehicle by 32 degrees rotates the fan image."""
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


def test_weak_features_are_added_up_to_min_count() -> None:
    image = draw_debris()
    strong = detect(image, make_config("akaze", "polar", threshold=4e-3, min_count=0))
    filled = detect(image, make_config("akaze", "polar", threshold=4e-3, min_count=20))
    assert 0 < len(strong) < len(filled) == 20
    np.testing.assert_array_equal(filled.row_column[: len(strong)], strong.row_column)
    assert (strong.response >= 4e-3).all() and (filled.response[len(strong) :] < 4e-3).all()
    assert (filled.response >= 4e-3 / 5).all()
