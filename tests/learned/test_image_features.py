"""Learned features of one image, with a stand-in for the network: positions, mask, number, cache and bad input."""

from collections.abc import Callable

import numpy as np
import pytest

from asfm.config import KeypointsConfig
from asfm.errors import AsfmError
from asfm.frontend.features.keypoints import BORDER_ROWS
from asfm.geometry.sonar import SonarModel
from asfm.learned import image_features
from asfm.learned.image_features import (
    MULTIPLE_PX,
    Candidates,
    FeatureCache,
    ImageFeatures,
    View,
    detect_features,
    provide_features,
)
from asfm.types import FloatArray, ImageArray

SHAPE = (230, 90)
SONAR = SonarModel.evenly_spaced("test", (1.0, 6.0), (-0.7, 0.7), SHAPE, 0.3)
SHARP = KeypointsConfig(smoothing_px=0)
EVERYWHERE = np.ones(SHAPE, dtype=bool)


def find_centroid(image: ImageArray, count: int) -> Candidates:
    """Stand-in for a network: the centroid of a bright spot."""
    assert image.shape[0] % MULTIPLE_PX == 0 and image.shape[1] % MULTIPLE_PX == 0 and image.dtype == np.float32
    weight = np.where(image > 0.2 * image.max(), image, 0).astype(float)
    rows, columns = np.arange(image.shape[0]), np.arange(image.shape[1])
    x, y = (weight.sum(axis=0) @ columns / weight.sum(), weight.sum(axis=1) @ rows / weight.sum())
    xy_px = np.array([[float(x), float(y)]])
    return Candidates(xy_px, np.ones(1), np.ones((1, 4), dtype=np.float32))


def find_grid(image: ImageArray, count: int) -> Candidates:
    """Stand-in for a network: every eighth pixel, with scores that rise to the right."""
    row_column = np.argwhere(np.ones(np.array(image.shape) // 8)) * 8
    xy_px = row_column[:, ::-1].astype(float)
    return Candidates(xy_px, xy_px[:, 0], xy_px.astype(np.float32))


def draw_spot(xy_px: tuple[float, float]) -> ImageArray:
    rows, columns = np.indices(SHAPE)
    squared = ((columns - xy_px[0]) ** 2 + (rows - xy_px[1]) ** 2) / (2 * 3.0**2)
    return np.asarray(np.exp(-squared), dtype=np.float32)


@pytest.mark.parametrize("xy_px", [(40.0, 100.0), (29.5, 50.25), (57.0, 180.75)])
@pytest.mark.parametrize(
    "view", [View(None, SHARP), View(SONAR, SHARP), View(SONAR, KeypointsConfig(smoothing_px=0, space="fan"))]
)
def test_positions_are_those_of_the_polar_image(xy_px: tuple[float, float], view: View) -> None:
    features = detect_features(find_centroid, draw_spot(xy_px), EVERYWHERE, view)
    tolerance_px = 0.1 if view.settings.space == "polar" else 0.5  # the spot's centroid itself moves on the fan
    assert features.xy_px == pytest.approx(np.array([xy_px]), abs=tolerance_px)


def test_the_image_is_stretched_to_square_pixels_along_bearing() -> None:
    features = detect_features(find_centroid, draw_spot((40, 100)), EVERYWHERE, View(SONAR, SHARP))
    stretch = 3.5 * SONAR.bearing_step_rad / SONAR.range_step_m
    assert stretch > 1.5
    assert features.warped_size_px[0] == pytest.approx(SHAPE[1] * stretch + 32, abs=32)
    assert features.warped_size_px[1] == 256


def test_features_lie_inside_the_mask_and_not_in_the_border_rows() -> None:
    mask = np.zeros(SHAPE, dtype=bool)
    mask[:, 30:60] = True
    xy_px = detect_features(find_grid, draw_spot((40, 100)), mask, View(SONAR)).xy_px
    assert len(xy_px) > 50
    assert xy_px[:, 0].min() >= 29.5 and xy_px[:, 0].max() <= 60
    assert xy_px[:, 1].min() >= BORDER_ROWS - 0.5 and xy_px[:, 1].max() <= SHAPE[0] - BORDER_ROWS


def test_without_a_mask_features_lie_on_echoes() -> None:
    image = draw_spot((40, 100)) + np.random.default_rng(0).rayleigh(0.02, SHAPE).astype(np.float32)
    xy_px = detect_features(find_grid, image, None, View(SONAR)).xy_px
    assert len(xy_px) > 0
    assert np.hypot(*(xy_px - (40, 100)).T).max() < 25


def test_the_strongest_are_kept_strongest_first() -> None:
    settings = KeypointsConfig(max_count=20)
    many = detect_features(find_grid, draw_spot((40, 100)), EVERYWHERE, View(SONAR))
    few = detect_features(find_grid, draw_spot((40, 100)), EVERYWHERE, View(SONAR, settings))
    assert len(few) == 20 < len(many)
    assert (few.xy_px == many.xy_px[:20]).all() and (np.diff(many.warped_xy_px[:, 0]) <= 0).all()
    assert (few.descriptors == few.warped_xy_px).all(), "descriptors of other features"


def count_calls(monkeypatch: pytest.MonkeyPatch, cache_size: int = 8) -> tuple[list[int], Callable[..., Candidates]]:
    monkeypatch.setattr(image_features, "CACHE", FeatureCache(cache_size))
    calls: list[int] = []

    def detect(image: ImageArray, count: int) -> Candidates:
        calls.append(count)
        return find_grid(image, count)

    return calls, detect


def test_features_of_the_same_content_are_computed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    calls, detect = count_calls(monkeypatch)
    image = draw_spot((40, 100))
    first = provide_features(detect, image, EVERYWHERE, View(SONAR))
    assert provide_features(detect, image.copy(), EVERYWHERE.copy(), View(SONAR)) is first
    assert len(calls) == 1


@pytest.mark.parametrize("change", ["image", "mask", "sonar", "settings", "network"])
def test_features_of_anything_else_are_computed_anew(change: str, monkeypatch: pytest.MonkeyPatch) -> None:
    calls, detect = count_calls(monkeypatch)
    image, mask, view = draw_spot((40, 100)), EVERYWHERE, View(SONAR)
    provide_features(detect, image, mask, view)
    if change == "network":
        provide_features(lambda *given: detect(*given), image, mask, view)
    else:
        image = draw_spot((41, 100)) if change == "image" else image
        changed = np.eye(*SHAPE, dtype=bool) if change == "mask" else mask
        view = View(None) if change == "sonar" else view
        view = View(SONAR, KeypointsConfig(max_count=7)) if change == "settings" else view
        provide_features(detect, image, changed, view)
    assert len(calls) == 2


def test_the_cache_forgets_what_was_not_used_for_longest() -> None:
    cache = FeatureCache(2)
    made: list[str] = []

    def provide(name: str) -> None:
        def make() -> ImageFeatures:
            made.append(name)
            return ImageFeatures(np.zeros((0, 2)), np.zeros((0, 2)), (1, 1), np.zeros((0, 1), dtype=np.float32))

        cache.provide((name,), make)

    for name in "abacab":
        provide(name)
    assert made == ["a", "b", "c", "b"] and len(cache) == 2


@pytest.mark.parametrize("shape", [(8, 8), (20, 400), (400, 4)])
def test_small_images_have_no_features(shape: tuple[int, int]) -> None:
    image = np.random.default_rng(0).random(shape, dtype=np.float32)
    assert len(detect_features(find_grid, image, np.ones(shape, dtype=bool), View())) == 0


def test_a_black_image_has_no_features() -> None:
    assert len(provide_features(find_grid, np.zeros(SHAPE, dtype=np.float32), None, View())) == 0


def replace_pixel(value: float) -> FloatArray:
    image = draw_spot((40, 100)).astype(float)
    image[3, 4] = value
    return image


def test_bad_images_are_one_line() -> None:
    with pytest.raises(AsfmError, match="finite image, found others, in row 3, column 4"):
        provide_features(find_grid, replace_pixel(np.nan).astype(np.float32), None, View())
    with pytest.raises(AsfmError, match=r"\(230, 90\) pixels"):
        provide_features(find_grid, np.zeros((40, 40), dtype=np.float32), None, View(SONAR))
    with pytest.raises(AsfmError, match=r"and \(40, 40\)"):
        provide_features(find_grid, draw_spot((40, 100)), np.ones((40, 40), dtype=bool), View())
    with pytest.raises(AsfmError, match="found no sonar"):
        provide_features(find_grid, draw_spot((40, 100)), None, View(None, KeypointsConfig(space="fan")))
