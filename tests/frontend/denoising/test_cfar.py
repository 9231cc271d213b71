"""CFAR detection against a plain double loop, and its false-alarm rate on noise."""

import math
from pathlib import Path
from typing import Any, Literal, get_args

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from asfm.config import CfarConfig
from asfm.errors import AsfmError
from asfm.frontend.denoising.cfar import detect_cfar
from asfm.frontend.denoising.cfar_factors import goca_soca_factors, order_ranks, os_factors
from asfm.types import BoolArray, ImageArray

CONFIG = CfarConfig(false_alarm_probability=1e-2, guard_px=(4, 4), reference_px=(16, 12))

Cell = tuple[int, int]
Method = Literal["ca", "goca", "soca", "os"]
METHODS: tuple[Method, ...] = get_args(Method)
Noise = Literal["rayleigh", "weibull"]
NOISES: tuple[Noise, ...] = get_args(Noise)


def change(config: CfarConfig, **settings: Any) -> CfarConfig:
    return CfarConfig.model_validate(config.model_dump() | settings)


def reference_cells(image: ImageArray, valid: BoolArray, config: CfarConfig, cell: Cell) -> list[tuple[int, float]]:
    """List the row relative to the cell under test, and the power, of each valid reference cell."""
    (row, column), cells = cell, []
    for i in range(-config.reference_px[0], config.reference_px[0] + 1):
        for j in range(-config.reference_px[1], config.reference_px[1] + 1):
            guarded = abs(i) <= config.guard_px[0] and abs(j) <= config.guard_px[1]
            inside = 0 <= row + i < image.shape[0] and 0 <= column + j < image.shape[1]
            if inside and not guarded and valid[row + i, column + j]:
                cells.append((i, float(image[row + i, column + j]) ** 2))
    return cells


def censoring_correction(cells: int, above_floor: int, probability: float) -> float:
    """Compute the factor's multiplier for left-censored noise from the cells in all and those above the floor."""
    if not cells or not above_floor:
        return float(not cells)
    return max(0.0, 1 - math.log(above_floor / cells) / math.log(probability))


def threshold(cells: list[tuple[int, float]], method: Method, probability: float) -> float:
    """Compute factor * statistic of the reference cells of one cell."""
    powers = sorted(power for _, power in cells)
    halves = [half for half in ([p for i, p in cells if i < 0], [p for i, p in cells if i > 0]) if half]
    n = len(powers)
    if n == 0 or (method in ("goca", "soca") and not halves):
        return math.inf
    if method == "ca":
        return float(probability ** (-1 / n) - 1) * sum(powers)
    if method == "os":
        factor, rank = os_factors(np.array([n]), probability, 0.75), int(order_ranks(np.array([n]), 0.75)[0])
        return float(factor[0]) * powers[rank - 1]
    before, behind = (np.array([sum(i * sign > 0 for i, _ in cells)]) for sign in (-1, 1))
    factor = goca_soca_factors(before, behind, probability, method == "goca")
    choose = max if method == "goca" else min
    return float(factor[0]) * choose(sum(half) / len(half) for half in halves)


@settings(deadline=None, max_examples=100)
@given(
    method=st.sampled_from(METHODS),
    shape=st.tuples(st.integers(1, 14), st.integers(1, 14)),
    guard_px=st.tuples(st.integers(0, 3), st.integers(0, 3)),
    wider_px=st.tuples(st.integers(0, 9), st.integers(0, 9)).filter(any),
    probability=st.sampled_from([0.5, 0.1, 1e-2, 1e-4]),
    invalid_share=st.sampled_from([0.0, 0.2, 0.9, 1.0]),
    noise=st.sampled_from(NOISES),
    cut=st.sampled_from([0.0, 1.0, 2.0]),
    seed=st.integers(0, 99),
)
def test_detections_are_those_of_a_plain_loop(
    method: Method,
    shape: tuple[int, int],
    guard_px: tuple[int, int],
    wider_px: tuple[int, int],
    probability: float,
    invalid_share: float,
    noise: Noise,
    cut: float,
    seed: int,
) -> None:
    """Images too small for a Weibull shape, which default to Rayleigh noise; its censoring applies with weibull."""
    rng = np.random.default_rng(seed)
    image = rng.rayleigh(size=shape).astype(np.float32)
    image[rng.random(shape) < 0.1] *= 5
    image = np.maximum(image - np.float32(cut), 0)
    valid = rng.random(shape) >= invalid_share
    floor = image[valid].min(initial=np.inf) if noise == "weibull" else -1.0
    above = np.asarray(valid & (image > floor))
    if above.sum() > 0.99 * valid.sum():
        above = valid
    reference_px = (guard_px[0] + wider_px[0], guard_px[1] + wider_px[1])
    config = CfarConfig(
        false_alarm_probability=probability,
        guard_px=guard_px,
        reference_px=reference_px,
        method=method,
        noise=noise,
    )
    expected = np.zeros(shape, dtype=bool)
    for cell in np.ndindex(shape):
        cells = reference_cells(image, above, config, cell)
        correction = censoring_correction(len(reference_cells(image, valid, config, cell)), len(cells), probability)
        limit = correction * threshold(cells, method, probability) if correction else 0.0
        expected[cell] = above[cell] and float(image[cell]) ** 2 > limit
    np.testing.assert_array_equal(detect_cfar(image, valid, config), expected)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("probability", [1e-1, 1e-2, 1e-3])
@pytest.mark.parametrize(("guard_px", "reference_px"), [((4, 4), (16, 12)), ((2, 0), (14, 0))])
@pytest.mark.parametrize("noise", NOISES)
def test_false_alarm_rate_on_noise_is_the_configured_one(
    method: Method, probability: float, guard_px: tuple[int, int], reference_px: tuple[int, int], noise: Noise
) -> None:
    rng = np.random.default_rng(1)
    config = CfarConfig(false_alarm_probability=probability, guard_px=guard_px, reference_px=reference_px, noise=noise)
    valid = np.ones((800, 600), dtype=bool)
    valid[:, 400:410] = False
    power = rng.exponential(size=valid.shape).astype(np.float32)
    detected = detect_cfar(np.sqrt(power), valid, change(config, method=method))
    # A tenth of the configured rate, or three standard deviations of so few detections.
    tolerance = max(0.1, 3 / np.sqrt(probability * valid.sum()))
    assert detected[valid].mean() == pytest.approx(probability, rel=tolerance)
    border = valid.copy()
    border[10:-10, 10:-10] = False
    assert detected[border].mean() == pytest.approx(probability, rel=4 / np.sqrt(probability * border.sum()))
    assert not detected[~valid].any()
    if noise == "rayleigh":
        same = detect_cfar(power, valid, change(config, method=method, noise="exponential"))
        assert (same != detected).mean() < 1e-5


def test_detections_do_not_depend_on_the_unit() -> None:
    image = np.random.default_rng(2).rayleigh(size=(60, 70)).astype(np.float32)
    valid = np.ones(image.shape, dtype=bool)
    detected = detect_cfar(image, valid, CONFIG)
    for gain in (2.0**-20, 2.0**16):
        np.testing.assert_array_equal(detect_cfar((gain * image).astype(np.float32), valid, CONFIG), detected)
    counts = np.round(1000 * image).astype(np.uint16)
    same = detect_cfar(counts.astype(np.float32), valid, CONFIG)
    np.testing.assert_array_equal(detect_cfar(counts, valid, CONFIG), same)


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("value", [0.0, 0.3, 1.0, 65535.0])
def test_a_constant_image_has_no_detections(value: float, method: Method, noise: Noise) -> None:
    image = np.full((50, 60), value, dtype=np.float32)
    assert not detect_cfar(image, np.ones(image.shape, dtype=bool), change(CONFIG, method=method, noise=noise)).any()


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("method", METHODS)
def test_a_bright_target_causes_no_false_detections(method: Method, noise: Noise) -> None:
    image = np.zeros((120, 120), dtype=np.float32)
    image[40, 40] = 1.0
    image[80, 83] = 1e-4
    found = np.argwhere(
        detect_cfar(image, np.ones(image.shape, dtype=bool), change(CONFIG, method=method, noise=noise))
    )
    np.testing.assert_array_equal(found, [[40, 40], [80, 83]])


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("hole", [np.nan, np.inf, -np.inf])
def test_non_finite_pixels_are_invalid(hole: float, method: Method, noise: Noise) -> None:
    rng = np.random.default_rng(3)
    image = rng.rayleigh(size=(40, 50)).astype(np.float32)
    valid = rng.random(image.shape) > 0.2
    holed = np.where(valid, image, np.float32(hole))
    everywhere = np.ones(image.shape, dtype=bool)
    detected = detect_cfar(holed, everywhere, change(CONFIG, method=method, noise=noise))
    np.testing.assert_array_equal(detected, detect_cfar(image, valid, change(CONFIG, method=method, noise=noise)))
    nothing = np.full((9, 9), hole, dtype=np.float32)
    assert not detect_cfar(nothing, everywhere[:9, :9], change(CONFIG, method=method, noise=noise)).any()


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("method", METHODS)
def test_images_of_one_or_no_valid_pixel_have_no_detections(method: Method, noise: Noise) -> None:
    one = np.ones((1, 1), dtype=np.float32)
    assert not detect_cfar(one, one > 0, change(CONFIG, method=method, noise=noise)).any()
    image = np.random.default_rng(0).random((30, 30)).astype(np.float32)
    assert not detect_cfar(image, np.zeros(image.shape, dtype=bool), change(CONFIG, method=method, noise=noise)).any()


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("method", METHODS)
def test_windows_larger_than_the_image_cover_all_of_it(method: Method, noise: Noise) -> None:
    image = np.random.default_rng(5).rayleigh(size=(21, 17)).astype(np.float32)
    valid = np.ones(image.shape, dtype=bool)
    large, huge, all_guard = (
        CfarConfig(false_alarm_probability=0.1, guard_px=guard_px, reference_px=reference_px)
        for guard_px, reference_px in [((1, 1), (20, 16)), ((1, 1), (500, 500)), ((50, 50), (99, 99))]
    )
    detected = detect_cfar(image, valid, change(huge, method=method, noise=noise))
    assert detected.any()
    np.testing.assert_array_equal(detected, detect_cfar(image, valid, change(large, method=method, noise=noise)))
    assert not detect_cfar(image, valid, change(all_guard, method=method, noise=noise)).any()


def test_goca_reduces_edge_alarms_and_soca_target_masking() -> None:
    rng = np.random.default_rng(6)
    image = rng.rayleigh(size=(400, 100)).astype(np.float32)
    image[200:] *= 10
    valid = np.ones(image.shape, dtype=bool)
    edge = slice(200, 212)
    alarms = {m: detect_cfar(image, valid, change(CONFIG, method=m))[edge].mean() for m in METHODS}
    assert alarms["goca"] < 0.3 * alarms["ca"] < alarms["soca"]
    image = rng.rayleigh(size=(100, 100)).astype(np.float32)
    image[40, 20::20] = 6
    image[44:56, 10:90] = 30
    found = {m: detect_cfar(image, valid[:100], change(CONFIG, method=m))[40, 20::20].sum() for m in METHODS}
    assert found["goca"] == found["ca"] == 0
    assert found["soca"] == 4


def test_invalid_input_is_an_error() -> None:
    image = np.zeros((5, 5), dtype=np.float32)
    with pytest.raises(AsfmError, match=r"\(5, 5\) and \(4, 5\)"):
        detect_cfar(image, np.ones((4, 5), dtype=bool), CONFIG)
    with pytest.raises(AsfmError, match="expected a non-empty image"):
        detect_cfar(image[:0], np.ones((0, 5), dtype=bool), CONFIG)


def test_few_detections_in_recorded_empty_water(shared_data: Path) -> None:
    rates = []
    for path in sorted((shared_data / "didson_hull" / "open_water").glob("*.png"))[::8]:
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        assert image is not None
        rates.append(detect_cfar(image, np.ones(image.shape, dtype=bool), CONFIG).mean())
    assert 0 < float(np.mean(rates)) < 0.15


@pytest.mark.parametrize("noise", ["rayleigh", "exponential", "weibull"])
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("guard_px", "reference_px"), [((4, 4), (16, 12)), ((2, 0), (14, 0))])
def test_false_alarm_rate_is_within_a_tenth_of_the_configured_one(
    method: Method, noise: str, guard_px: Cell, reference_px: Cell
) -> None:
    """At least two thousand false alarms are expected, so that a tenth is four and a half standard deviations.

    After the transformation to exponential power the noise models share their code: OS, the slow one, is tested at the
    lowest probability with one of them only.
    """
    rng = np.random.default_rng(11)
    valid = np.ones((512, 512), dtype=bool)
    for probability, images in ((1e-1, 1), (1e-2, 1), (1e-3, 8)):
        if images > 1 and method == "os" and noise != "rayleigh":
            continue
        found = 0
        for _ in range(images):
            power = rng.exponential(size=valid.shape).astype(np.float32)
            image = {"rayleigh": np.sqrt(power), "exponential": power, "weibull": power**0.25}[noise]
            config = change(CONFIG, guard_px=guard_px, reference_px=reference_px, method=method, noise=noise)
            found += int(detect_cfar(image, valid, change(config, false_alarm_probability=probability)).sum())
        assert found == pytest.approx(images * valid.size * probability, rel=0.1)


def rate_of(folder: Path, rows: slice, step: int, **settings: Any) -> float:
    """Compute the share of detected pixels in some rows over a few frames of a recording."""
    rates = []
    for path in sorted(folder.glob("*.png"))[::step]:
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        assert image is not None
        config = CfarConfig.model_validate(settings)
        rates.append(detect_cfar(image, np.ones(image.shape, dtype=bool), config)[rows].mean())
    return float(np.mean(rates))


@pytest.mark.parametrize("method", ["ca", "goca"])
@pytest.mark.parametrize("probability", [0.1, 0.05, 0.01])
def test_false_alarm_rate_in_recorded_empty_water_of_unknown_compression(
    method: Method, probability: float, shared_data: Path
) -> None:
    """A DIDSON that censors most of the noise, and an Oculus whose images show the root of the amplitude."""
    configured = {"false_alarm_probability": probability, "method": method, "noise": "weibull"}
    didson = rate_of(shared_data / "didson_hull" / "open_water", slice(None), 12, **configured)
    assert didson == pytest.approx(probability, rel=0.2)
    tank = rate_of(shared_data / "oculus_tank_b" / "frames", slice(560, 690), 30, **configured)
    assert tank == pytest.approx(probability, rel=0.3)
    plain = rate_of(shared_data / "oculus_tank_b" / "frames", slice(560, 690), 60, **configured | {"noise": "rayleigh"})
    assert plain < 0.5 * probability
