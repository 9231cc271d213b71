"""Intensity normalisation: quantile, soft knee and independence of the gain."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from asfm.config import KeypointsConfig
from asfm.frontend.features.intensity import BRIGHT_QUANTILE, KNEE, find_quantile, normalise_intensity
from asfm.types import ImageArray

NO_SMOOTHING = KeypointsConfig(smoothing_px=0)


@given(
    arrays(np.float32, array_shapes(min_dims=2, max_dims=2, max_side=30), elements=st.floats(0, 1, width=32)),
    st.floats(0, 1),
)
def test_the_quantile_is_that_of_numpy(image: ImageArray, quantile: float) -> None:
    expected = float(np.quantile(image.astype(float), quantile))
    assert find_quantile(image, quantile) == pytest.approx(expected, abs=1e-9)


def test_the_scale_is_linear_below_the_knee_and_never_clips_above() -> None:
    image = np.linspace(0, 1, 40000, dtype=np.float32).reshape(200, 200)
    image[-1, -10:] = 5.0
    normalised = normalise_intensity(image, NO_SMOOTHING)
    linear = image / find_quantile(image, BRIGHT_QUANTILE)
    np.testing.assert_allclose(normalised[linear <= KNEE], linear[linear <= KNEE], rtol=1e-6)
    assert (
        (np.diff(normalised.ravel()[:-10]) > 0).all()
        and normalised[-1, -1] > normalised[-1, -11]
        and normalised.max() < 1
    )
    slope = np.diff(normalised.ravel()[:-10]).reshape(-1)
    assert slope.max() == pytest.approx(np.median(slope), rel=0.01), "no jump and no kink upwards at the knee"


@pytest.mark.parametrize("smoothing_px", [0.0, 2.0])
@pytest.mark.parametrize("factor", [1e-40, 1e-3, 1.0, 1e3])
def test_the_gain_is_normalised_and_the_image_not_modified(factor: float, smoothing_px: float) -> None:
    image = np.random.default_rng(0).rayleigh(0.1, (60, 50)).astype(np.float32)
    settings = KeypointsConfig(smoothing_px=smoothing_px)
    scaled = np.asarray(image * np.float32(factor))
    before = scaled.copy()
    with np.errstate(all="raise", under="ignore"):
        normalised = normalise_intensity(scaled, settings)
    np.testing.assert_array_equal(scaled, before)
    if factor > 1e-30:  # subnormal single precision numbers are too coarse
        np.testing.assert_allclose(normalised, normalise_intensity(image, settings), rtol=1e-4, atol=1e-6)
    assert np.isfinite(normalised).all() and 0 <= normalised.min() <= normalised.max() < 1


@pytest.mark.parametrize("image", [np.zeros((20, 20)), np.full((20, 20), -1.0), np.ones((1, 1))])
def test_constant_images_stay_constant(image: ImageArray) -> None:
    normalised = normalise_intensity(image.astype(np.float32), NO_SMOOTHING)
    expected = 0.0 if image.max() <= 0 else KNEE + 0.5 * (1 - KNEE)  # 1 before compression
    np.testing.assert_allclose(normalised, np.full(image.shape, expected), rtol=1e-6)


@pytest.mark.parametrize("gain", [1e-3, 50.0])
def test_the_gain_of_an_image_with_a_single_echo_does_not_matter(gain: float) -> None:
    """Fewer pixels than those above the quantile are not zero."""
    image = np.zeros((100, 80), dtype=np.float32)
    image[40:44, 30:34] = [0.2, 0.5, 1.0, 0.7]
    plain, changed = (normalise_intensity(np.float32(by) * image, KeypointsConfig()) for by in (1.0, gain))
    np.testing.assert_allclose(changed, plain, rtol=1e-5)
    assert 0.2 < plain.max() <= 1
