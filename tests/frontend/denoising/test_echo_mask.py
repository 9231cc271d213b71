"""Echo mask: CFAR and DBSCAN combined, the margin, and invalid pixels."""

import numpy as np
import pytest
from scipy.ndimage import binary_dilation
from sklearn.cluster import DBSCAN

from asfm.config import Config, KeypointsConfig
from asfm.config_file import load_config
from asfm.frontend.denoising.cfar import detect_cfar
from asfm.frontend.denoising.echo_mask import detect_echo_mask
from asfm.types import BoolArray, Frame, ImageArray

SHAPE = (120, 90)
DATA = np.zeros(SHAPE, dtype=bool)


def config_of(margin_px: int) -> Config:
    return Config(keypoints=KeypointsConfig(margin_px=margin_px))


def draw_echo(seed: int = 0) -> ImageArray:
    """Draw Rayleigh noise with one bright object in rows 50..59 and columns 20..31, to starboard of the middle."""
    rng = np.random.default_rng(seed)
    image = rng.rayleigh(0.05, SHAPE).astype(np.float32)
    image[50:60, 20:32] += 0.7
    return np.clip(image, 0, 1)


def mask_of(image: ImageArray, margin_px: int = 4, invalid: BoolArray = DATA) -> BoolArray:
    return detect_echo_mask(Frame(0, 0.0, image, invalid), config_of(margin_px))


def plain_mask(image: ImageArray, margin_px: int, invalid: BoolArray) -> BoolArray:
    """Compute the same mask with scikit-learn's DBSCAN and SciPy's dilation."""
    config = config_of(margin_px)
    where = np.argwhere(detect_cfar(image, ~invalid, config.cfar))
    label = DBSCAN(eps=config.clusters.radius_px, min_samples=config.clusters.min_pixels).fit_predict(where)
    mask = np.zeros(image.shape, dtype=bool)
    mask[tuple(where[label >= 0].T)] = True
    grown = binary_dilation(mask, np.ones((2 * margin_px + 1, 2 * margin_px + 1), dtype=bool))
    return np.asarray(grown & ~invalid)


@pytest.mark.parametrize("margin_px", [0, 1, 4])
@pytest.mark.parametrize("seed", range(3))
def test_the_mask_agrees_with_independent_libraries(margin_px: int, seed: int) -> None:
    image, invalid = draw_echo(seed), DATA.copy()
    invalid[:, 40:44] = True
    invalid[52:54, 22:26] = True
    np.testing.assert_array_equal(mask_of(image, margin_px, invalid), plain_mask(image, margin_px, invalid))


def test_an_echo_is_in_the_mask_and_empty_water_is_not() -> None:
    mask = mask_of(draw_echo())
    assert mask.dtype == bool and mask.shape == SHAPE
    assert mask[50:60, 20:32].all()
    far = np.ones(SHAPE, dtype=bool)
    far[40:70, 10:42] = False
    assert mask[far].mean() < 0.15
    assert not mask[50:60, 58:70].all(), "mirrored, it would be the echo"


def test_the_mask_is_dilated_by_exactly_the_margin() -> None:
    image = np.full(SHAPE, 0.01, dtype=np.float32)
    image[50:56, 20:26] = 1.0
    for margin_px in (0, 2, 5):
        expected = np.zeros(SHAPE, dtype=bool)
        expected[50 - margin_px : 56 + margin_px, 20 - margin_px : 26 + margin_px] = True
        np.testing.assert_array_equal(mask_of(image, margin_px), expected)


def test_the_margin_stops_at_the_border() -> None:
    image = np.full(SHAPE, 0.01, dtype=np.float32)
    image[:5, -5:] = 1.0
    expected = np.zeros(SHAPE, dtype=bool)
    expected[:9, -9:] = True
    np.testing.assert_array_equal(mask_of(image, 4), expected)


def test_invalid_pixels_are_not_in_the_mask_and_have_no_effect() -> None:
    invalid = DATA.copy()
    invalid[45:65, 26:36] = True
    image = draw_echo()
    mask = mask_of(image, invalid=invalid)
    assert mask[50:60, 20:26].all() and not mask[invalid].any()
    np.testing.assert_array_equal(mask_of(np.where(invalid, np.float32(0.123), image), invalid=invalid), mask)


def test_isolated_pixels_are_removed() -> None:
    image = np.full(SHAPE, 0.01, dtype=np.float32)
    image[::20, ::20] = 1.0
    assert not mask_of(image).any()


@pytest.mark.parametrize("value", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("shape", [SHAPE, (1, 1), (1, 40), (40, 1), (2, 2)])
def test_a_uniform_image_has_no_echoes(shape: tuple[int, int], value: float) -> None:
    mask = mask_of(np.full(shape, value, dtype=np.float32), invalid=np.zeros(shape, dtype=bool))
    assert mask.shape == shape and not mask.any()


def test_an_image_without_valid_pixels_has_no_echoes() -> None:
    assert not mask_of(draw_echo(), invalid=~DATA).any()


def test_the_mask_is_deterministic_and_the_image_not_modified() -> None:
    image = draw_echo()
    before = image.copy()
    image.flags.writeable = False
    np.testing.assert_array_equal(mask_of(image), mask_of(image))
    np.testing.assert_array_equal(image, before)


def test_logarithmic_images_are_detected_on_their_amplitude() -> None:
    """The same echoes stored in decibels give the same mask."""
    rng = np.random.default_rng(5)
    amplitude = rng.rayleigh(0.02, (120, 90)).astype(np.float32).clip(1e-4, 1)
    amplitude[50:56, 30:38] = 0.8
    nowhere = np.zeros(amplitude.shape, dtype=bool)
    plain = Frame(0, 0.0, amplitude, nowhere)
    decibels = Frame(0, 0.0, 1 + 20 * np.log10(amplitude) / np.float32(80), nowhere, decibel_span=80.0)
    np.testing.assert_allclose(decibels.amplitude, amplitude, rtol=1e-4)
    config = Config()
    np.testing.assert_array_equal(detect_echo_mask(decibels, config), detect_echo_mask(plain, config))
    assert detect_echo_mask(plain, config)[50:56, 30:38].all()


def test_the_mask_depends_on_the_settings_of_cfar() -> None:
    image = draw_echo()
    plain = mask_of(image)
    power = detect_echo_mask(Frame(0, 0.0, image * image, DATA), load_config(None, ("cfar.noise=exponential",)))
    np.testing.assert_array_equal(power, plain)
    root = detect_echo_mask(Frame(0, 0.0, np.sqrt(image), DATA), load_config(None, ("cfar.noise=weibull",)))
    assert (root != plain).mean() < 0.03
    many = "cfar.false_alarm_probability=0.3"
    plain = detect_echo_mask(Frame(0, 0.0, image, DATA), load_config(None, (many,)))
    for settings in (("cfar.method=soca",), ("cfar.method=os",), ("cfar.guard_px=[4, 0]", "cfar.reference_px=[16, 0]")):
        mask = detect_echo_mask(Frame(0, 0.0, image, DATA), load_config(None, (many, *settings)))
        assert mask[50:60, 20:32].any() and (mask != plain).any()
