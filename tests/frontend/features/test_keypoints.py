"""Keypoint detection: position accuracy, mask and borders, determinism, and images without keypoints."""

import subprocess
import sys
import warnings

import cv2
import numpy as np
import pytest

from asfm.config import Config, KeypointsConfig
from asfm.errors import AsfmError
from asfm.frontend.features.image_warp import column_stretch
from asfm.frontend.features.keypoints import cut_keypoint_patches, detect_keypoints
from asfm.geometry.sonar import SonarModel
from asfm.types import BoolArray, FloatArray, Frame, ImageArray, Keypoints

SHAPE = (240, 120)


def make_sonar(bearing_deg: float, shape: tuple[int, int] = SHAPE, uneven: bool = False) -> SonarModel:
    """Make a sonar of 1 to 6 m range; uneven beams are about three times as dense to port as to starboard."""
    half_rad = np.radians(bearing_deg) / 2
    even = SonarModel.evenly_spaced("test", (1.0, 6.0), (-half_rad, half_rad), shape, 0.3)
    if not uneven:
        return even
    part = (np.arange(shape[1]) + 0.5) / shape[1]
    return SonarModel("test", even.range_m, half_rad * (3 * part - part**2 - 1), 0.3)


SONARS = {
    "square pixels": make_sonar(20),
    "wide beams": make_sonar(90),
    "beams wider than the limit": make_sonar(170),
    "uneven beams": make_sonar(90, uneven=True),
}


def frame_of(image: ImageArray) -> Frame:
    return Frame(0, 0.0, np.asarray(image, dtype=np.float32), np.zeros(image.shape, dtype=bool))


def detect(
    image: ImageArray, sonar: SonarModel, mask: BoolArray | None = None, config: Config | None = None
) -> Keypoints:
    mask = np.ones(image.shape, dtype=bool) if mask is None else mask
    return detect_keypoints(frame_of(image), mask, sonar, config or Config())


def draw_blob(row_column: FloatArray, sonar: SonarModel, sigma_px: float = 4.0) -> ImageArray:
    """Draw a Gaussian that is round on the image stretched to square pixels."""
    stretch = column_stretch(sonar, KeypointsConfig())
    rows, columns = (np.arange(length) + 0.5 for length in sonar.shape)
    squared = (rows[:, None] - row_column[0]) ** 2 + (stretch * (columns - row_column[1])) ** 2
    return np.asarray(np.exp(-squared / (2 * sigma_px**2)), dtype=np.float32)


def detect_blob(row_column: FloatArray, sonar: SonarModel) -> Keypoints:
    """Detect a blob; a bright strip outside the mask sets the gain, or the top of the blob would be compressed."""
    image, mask = draw_blob(row_column, sonar), np.ones(sonar.shape, dtype=bool)
    image[:6], mask[:30] = 1.0, False
    return detect(image, sonar, mask)


def draw_debris(seed: int = 0, shape: tuple[int, int] = SHAPE) -> ImageArray:
    """Draw blurred noise with a rectangle: plenty of features."""
    rng = np.random.default_rng(seed)
    image = cv2.GaussianBlur(rng.random(shape, np.float32), (0, 0), 2.0)
    image = (image - image.min()) / (image.max() - image.min())
    image[90:140, 40:80] = 1.0
    return np.asarray(image, dtype=np.float32)


def check_shapes(found: Keypoints, config: Config | None = None) -> None:
    """Check the shapes and types that matching relies on."""
    count, width = len(found), 2 * (config or Config()).patch_radius_px + 1
    assert found.row_column.shape == (count, 2)
    assert found.range_m.shape == found.bearing_rad.shape == found.response.shape == (count,)
    assert found.descriptors.shape == (count, 61) and found.descriptors.dtype == np.uint8
    assert found.patches.shape == (count, width, width) and found.patches.dtype == np.float32


def test_column_stretch_of_the_sonars() -> None:
    stretch = {name: column_stretch(sonar, KeypointsConfig()) for name, sonar in SONARS.items()}
    assert stretch["square pixels"] == 1.0
    assert 1.5 < stretch["wide beams"] < 4.0
    assert 1.5 < stretch["uneven beams"] < 4.0
    assert stretch["beams wider than the limit"] == 4.0
    middle_m = 0.5 * (1.0 + 6.0)
    assert stretch["wide beams"] == pytest.approx(middle_m * np.radians(90) / 120 / (5 / 240))


@pytest.mark.parametrize("name", SONARS)
@pytest.mark.parametrize("row_column", [(120.5, 60.5), (90.2, 44.8), (150.3, 66.4)])
def test_a_blob_is_detected_at_its_position(name: str, row_column: tuple[float, float]) -> None:
    sonar = SONARS[name]
    where = np.array(row_column)
    found = detect_blob(where, sonar)
    check_shapes(found)
    assert len(found)
    for row, column in found.row_column:
        assert (row, column) == pytest.approx(where, abs=0.2), "only the blob is detected, at one or several scales"
    edges_m, edges_rad = sonar.range_edges_m, sonar.bearing_edges_rad
    range_m = np.interp(where[0], np.arange(len(edges_m)), edges_m)
    bearing_rad = np.interp(where[1], np.arange(len(edges_rad)), edges_rad)
    beam_rad = np.diff(edges_rad)[int(where[1])]
    assert found.range_m == pytest.approx(range_m, abs=0.2 * sonar.range_step_m)
    assert found.bearing_rad == pytest.approx(bearing_rad, abs=0.25 * beam_rad)


def test_positions_are_finer_than_a_pixel_and_unbiased() -> None:
    """A half pixel lost between two conventions would be a mean error of half a pixel."""
    sonar = SONARS["wide beams"]
    rng = np.random.default_rng(1)
    error = []
    for where in rng.uniform((100, 45), (140, 75), (24, 2)):
        error.append(detect_blob(where, sonar).row_column[0] - where)
    assert np.abs(np.mean(error, axis=0)) == pytest.approx(0, abs=0.05)
    assert np.std(error, axis=0) == pytest.approx(0, abs=0.1)


def test_port_is_positive_bearing_and_far_is_long_range() -> None:
    """One blob far to port: mirrored or swapped axes fail."""
    sonar = SONARS["uneven beams"]
    found = detect_blob(np.array([180.5, 85.5]), sonar)
    assert found.bearing_rad[0] == pytest.approx(sonar.bearing_rad[85], abs=0.01) and found.bearing_rad[0] > 0
    assert found.range_m[0] == pytest.approx(1.0 + 5.0 * 180.5 / 240, abs=0.02)


@pytest.mark.parametrize("name", SONARS)
def test_keypoints_lie_inside_the_mask_and_the_image(name: str) -> None:
    mask = np.zeros(SHAPE, dtype=bool)
    mask[80:130, 35:60] = True
    mask[150:180, 60:90] = True
    everywhere, inside = detect(draw_debris(), SONARS[name]), detect(draw_debris(), SONARS[name], mask)
    check_shapes(inside)
    assert 0 < len(inside) < len(everywhere)
    near = cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), dtype=np.uint8)).astype(bool)
    row, column = np.floor(inside.row_column).astype(int).T
    assert near[row, column].all(), "at most half a pixel of rounding off the mask"
    assert ((everywhere.row_column >= 0) & (everywhere.row_column <= SHAPE)).all()


def test_strongest_come_first_and_are_limited_to_max_count() -> None:
    sonar = SONARS["wide beams"]
    everything = detect(draw_debris(), sonar)
    few = detect(draw_debris(), sonar, config=Config(keypoints=KeypointsConfig(max_count=5)))
    assert (np.diff(everything.response) <= 0).all() and len(few) == 5
    for name in ("row_column", "range_m", "bearing_rad", "response", "descriptors", "patches"):
        np.testing.assert_array_equal(getattr(few, name), getattr(everything, name)[:5])


def test_keypoints_do_not_depend_on_the_gain() -> None:
    image, sonar = draw_debris(), SONARS["wide beams"]
    bright, dim = detect(image, sonar), detect(image * np.float32(1 / 64), sonar)
    np.testing.assert_array_equal(bright.row_column, dim.row_column)


def test_image_and_mask_are_not_modified() -> None:
    image, mask = draw_debris(), np.ones(SHAPE, dtype=bool)
    image.flags.writeable = mask.flags.writeable = False
    before = image.copy()
    assert len(detect(image, SONARS["wide beams"], mask))
    np.testing.assert_array_equal(image, before)
    assert mask.all()


def test_keypoints_do_not_depend_on_the_number_of_threads() -> None:
    before = cv2.getNumThreads()
    try:
        found = []
        for threads in (1, 2, 2):
            cv2.setNumThreads(threads)
            found.append(detect(draw_debris(), SONARS["wide beams"]))
    finally:
        cv2.setNumThreads(before)
    assert len(found[0])
    for other in found[1:]:
        for name in ("row_column", "range_m", "bearing_rad", "response", "descriptors", "patches"):
            assert getattr(other, name).tobytes() == getattr(found[0], name).tobytes(), name


@pytest.mark.parametrize("smoothing_px", [0.0, 2.0])
@pytest.mark.parametrize("value", [0.0, 1e-40, 1e-6, 0.5, 1.0])
def test_a_uniform_image_has_no_keypoints(value: float, smoothing_px: float) -> None:
    config = Config(keypoints=KeypointsConfig(smoothing_px=smoothing_px))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = detect(np.full(SHAPE, value, dtype=np.float32), SONARS["wide beams"], config=config)
    assert len(found) == 0
    check_shapes(found, config)


def test_an_empty_mask_has_no_keypoints() -> None:
    found = detect(draw_debris(), SONARS["wide beams"], np.zeros(SHAPE, dtype=bool))
    assert len(found) == 0
    check_shapes(found)


@pytest.mark.parametrize("name", SONARS)
@pytest.mark.parametrize("value", [1.0, 3.0, 1000.0])
def test_a_single_bright_pixel_moves_no_other_keypoint(name: str, value: float) -> None:
    image = draw_debris()
    before = detect(image, SONARS[name])
    image[70, 60] = value
    after = detect(image, SONARS[name])
    check_shapes(after)
    apart = np.abs(before.row_column - (70.5, 60.5)).max(axis=1) > 20
    shift_px = np.abs(before.row_column[apart, None] - after.row_column).max(axis=2).min(axis=1)
    assert apart.sum() > 30 and shift_px.max() < 0.5
    near = np.abs(after.row_column - (70.5, 60.5)).max(axis=1) < 20
    assert len(after) - len(before) <= near.sum()


SMALL_IMAGES = """
import numpy as np
from asfm.config import Config
from asfm.frontend.features.keypoints import cut_keypoint_patches, detect_keypoints
from asfm.geometry.sonar import SonarModel
from asfm.types import Frame

lengths = (0, 1, 2, 3, 5, 9, 15, 16, 50)
rng = np.random.default_rng(0)
detectors, spaces = ("akaze", "orb", "sift", "brisk"), ("polar", "fan")
configs = [Config(keypoints={"detector": d, "space": s}) for d in detectors for s in spaces]
for shape in [(rows, columns) for rows in lengths for columns in lengths] + [(1, 400), (400, 1), (2, 400), (400, 2)]:
    sonar = SonarModel.evenly_spaced("small", (1.0, 3.0), (-0.5, 0.5), (max(shape[0], 2), max(shape[1], 2)), 0.3)
    for image in (np.zeros(shape), np.ones(shape), rng.random(shape), rng.random(shape)):
        frame = Frame(0, 0.0, image.astype(np.float32), np.zeros(shape, bool))
        for config in configs:
            found = detect_keypoints(frame, np.ones(shape, bool), sonar, config)
            assert len(found) == 0 or min(shape) >= 16, shape
            side = 2 * config.patch_radius_px + 1
            assert found.patches.shape == (len(found), side, side), shape
            assert np.isfinite(found.row_column).all() and (found.row_column <= shape).all(), shape
"""


def test_very_small_images_have_no_keypoints() -> None:
    """In a subprocess: OpenCV writes beyond the bounds of such images and may crash."""
    done = subprocess.run([sys.executable, "-c", SMALL_IMAGES], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("columns", [30, 40, 60])
def test_small_images_have_the_keypoints_of_a_larger_image(columns: int) -> None:
    """Without padding A-KAZE detects nothing within about 27 pixels of a border."""
    whole, part = make_sonar(20), make_sonar(20 * columns / 120, (60, columns))
    image, config = draw_debris(3), Config(keypoints=KeypointsConfig(threshold=1e-4))
    everywhere = detect(image, whole, config=config).row_column
    image[:90] = image[150:] = 0
    begin = 60 - columns // 2
    found = detect(np.ascontiguousarray(image[90:150, begin : begin + columns]), part, config=config).row_column
    assert len(found) >= 5
    nearest_px = np.linalg.norm(found[:, None] + np.array([90, begin]) - everywhere, axis=2).min(axis=1)
    assert np.median(nearest_px) < 1.0


@pytest.mark.parametrize("detector", ["akaze", "sift"])
def test_nearest_and_farthest_rows_have_no_keypoints(detector: str) -> None:
    """Static noise of the sonar in these rows would be matched with itself; SIFT detects up to five pixels of it."""
    config = Config.model_validate({"keypoints": {"detector": detector}})
    found = detect(draw_debris(), SONARS["wide beams"], config=config)
    assert len(found) > 50
    assert found.row_column[:, 0].min() > 15 and found.row_column[:, 0].max() < SHAPE[0] - 15


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_non_finite_pixel_is_an_error(value: float) -> None:
    image = draw_debris()
    image[7, 11] = value
    with pytest.raises(AsfmError, match="row 7, column 11"):
        detect(image, SONARS["wide beams"])


def test_different_shapes_are_an_error() -> None:
    image, sonar = draw_debris(), SONARS["wide beams"]
    with pytest.raises(AsfmError, match="mask of the same shape"):
        detect(image, sonar, np.ones((3, 3), dtype=bool))
    with pytest.raises(AsfmError, match=r"sonar's \(240, 120\)"):
        detect(image[:200], sonar)


def test_patches_of_given_keypoints_equal_those_of_detected_ones() -> None:
    image, sonar = draw_debris(), SONARS["wide beams"]
    for space in ("polar", "fan"):
        config = Config.model_validate({"keypoints": {"space": space}})
        found = detect(image, sonar, config=config)
        given = cut_keypoint_patches(frame_of(image), found.without_patches(), sonar, config)
        same = (given.patches == found.patches).all(axis=(1, 2))
        assert same.mean() > 0.97, "rounding may select another pixel for keypoints on the edge between two"
