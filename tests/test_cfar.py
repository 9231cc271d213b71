"""Detection against a plain double loop, and its false-alarm rate on noise."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from asfm.config import CfarConfig
from asfm.errors import AsfmError
from asfm.frontend.cfar import detect_cfar
from asfm.types import BoolArray, ImageArray
from hypothesis import given, settings
from hypothesis import strategies as st

Cell = tuple[int, int]


def reference_cells(image: ImageArray, valid: BoolArray, config: CfarConfig, cell: Cell) -> list[tuple[Cell, float]]:
    """Where the usable reference cells of one cell lie, relative to it, and their power."""
    (row, column), cells = cell, []
    for i in range(-config.reference_px[0], config.reference_px[0] + 1):
        for j in range(-config.reference_px[1], config.reference_px[1] + 1):
            guarded = abs(i) <= config.guard_px[0] and abs(j) <= config.guard_px[1]
            inside = 0 <= row + i < image.shape[0] and 0 <= column + j < image.shape[1]
            if inside and not guarded and valid[row + i, column + j]:
                cells.append(((i, j), float(image[row + i, column + j]) ** 2))
    return cells


def is_detected(image: ImageArray, valid: BoolArray, config: CfarConfig, cell: Cell) -> bool:
    """Cell averaging, slowly and plainly."""
    powers = [power for _, power in reference_cells(image, valid, config, cell)]
    if not powers or not valid[cell]:
        return False
    n = len(powers)
    alpha = n * (config.false_alarm_probability ** (-1 / n) - 1)
    return bool(float(image[cell]) ** 2 > alpha * sum(powers) / n)


@settings(deadline=None, max_examples=40)
@given(
    shape=st.tuples(st.integers(1, 14), st.integers(1, 14)),
    guard_px=st.tuples(st.integers(0, 3), st.integers(0, 3)),
    wider_px=st.tuples(st.integers(1, 9), st.integers(1, 9)),
    probability=st.sampled_from([0.5, 0.1, 1e-2, 1e-4]),
    invalid_share=st.sampled_from([0.0, 0.2, 0.9, 1.0]),
    seed=st.integers(0, 99),
)
def test_detections_are_those_of_a_plain_loop(
    shape: tuple[int, int],
    guard_px: tuple[int, int],
    wider_px: tuple[int, int],
    probability: float,
    invalid_share: float,
    seed: int,
) -> None:
    rng = np.random.default_rng(seed)
    image = rng.rayleigh(size=shape).astype(np.float32)
    image[rng.random(shape) < 0.1] *= 5
    valid = rng.random(shape) >= invalid_share
    reference_px = (guard_px[0] + wider_px[0], guard_px[1] + wider_px[1])
    config = CfarConfig(false_alarm_probability=probability, guard_px=guard_px, reference_px=reference_px)
    expected = [[is_detected(image, valid, config, (r, c)) for c in range(shape[1])] for r in range(shape[0])]
    np.testing.assert_array_equal(detect_cfar(image, valid, config), expected)


@pytest.mark.parametrize("probability", [1e-1, 1e-2, 1e-3])
def test_false_alarm_rate_on_noise_is_the_asked_one(probability: float) -> None:
    rng = np.random.default_rng(1)
    config = CfarConfig(false_alarm_probability=probability)
    valid = np.ones((1000, 1000), dtype=bool)
    valid[:, 400:410] = False
    detected = detect_cfar(rng.rayleigh(size=valid.shape).astype(np.float32), valid, config)
    assert detected[valid].mean() == pytest.approx(probability, rel=0.1)
    border = valid.copy()
    border[10:-10, 10:-10] = False
    assert detected[border].mean() == pytest.approx(probability, rel=0.25)
    assert not detected[~valid].any()


def test_detections_do_not_depend_on_the_unit() -> None:
    image = np.random.default_rng(2).rayleigh(size=(60, 70)).astype(np.float32)
    valid = np.ones(image.shape, dtype=bool)
    detected = detect_cfar(image, valid, CfarConfig())
    for gain in (2.0**-20, 2.0**16):
        np.testing.assert_array_equal(detect_cfar((gain * image).astype(np.float32), valid, CfarConfig()), detected)
    counts = np.round(1000 * image).astype(np.uint16)
    same = detect_cfar(counts.astype(np.float32), valid, CfarConfig())
    np.testing.assert_array_equal(detect_cfar(counts, valid, CfarConfig()), same)


@pytest.mark.parametrize("value", [0.0, 0.3, 1.0, 65535.0])
def test_nothing_stands_out_of_a_constant_image(value: float) -> None:
    image = np.full((50, 60), value, dtype=np.float32)
    assert not detect_cfar(image, np.ones(image.shape, dtype=bool), CfarConfig()).any()


def test_a_bright_target_leaves_no_ghosts_in_the_dark() -> None:
    image = np.zeros((120, 120), dtype=np.float32)
    image[40, 40] = 1.0
    image[80, 83] = 1e-4
    found = np.argwhere(detect_cfar(image, np.ones(image.shape, dtype=bool), CfarConfig()))
    np.testing.assert_array_equal(found, [[40, 40], [80, 83]])


@pytest.mark.parametrize("hole", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_invalid(hole: float) -> None:
    rng = np.random.default_rng(3)
    image = rng.rayleigh(size=(40, 50)).astype(np.float32)
    valid = rng.random(image.shape) > 0.2
    holed = np.where(valid, image, np.float32(hole))
    everywhere = np.ones(image.shape, dtype=bool)
    np.testing.assert_array_equal(detect_cfar(holed, everywhere, CfarConfig()), detect_cfar(image, valid, CfarConfig()))
    assert not detect_cfar(np.full((9, 9), hole, dtype=np.float32), everywhere[:9, :9], CfarConfig()).any()


def test_one_pixel_and_no_valid_pixel_have_no_detections() -> None:
    assert not detect_cfar(np.ones((1, 1), dtype=np.float32), np.ones((1, 1), dtype=bool), CfarConfig()).any()
    image = np.random.default_rng(0).random((30, 30)).astype(np.float32)
    assert not detect_cfar(image, np.zeros(image.shape, dtype=bool), CfarConfig()).any()


def test_bad_input_is_refused_with_one_clear_line() -> None:
    image = np.zeros((5, 5), dtype=np.float32)
    with pytest.raises(AsfmError, match=r"\(5, 5\) and \(4, 5\)"):
        detect_cfar(image, np.ones((4, 5), dtype=bool), CfarConfig())
    with pytest.raises(AsfmError, match="expected an image"):
        detect_cfar(image[:0], np.ones((0, 5), dtype=bool), CfarConfig())


def test_empty_water_is_nearly_empty(shared_data: Path) -> None:
    rates = []
    for path in sorted((shared_data / "didson_hull" / "open_water").glob("*.png"))[::8]:
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        assert image is not None
        rates.append(detect_cfar(image, np.ones(image.shape, dtype=bool), CfarConfig()).mean())
    assert 0 < float(np.mean(rates)) < 0.15
