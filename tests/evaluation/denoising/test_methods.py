"""Denoising methods under comparison: noise reduction and degenerate images."""

import numpy as np
import pytest

from asfm.config import Config
from asfm.evaluation.denoising.methods import DENOISERS, MASK, OURS, RAW
from asfm.evaluation.denoising.metrics import measure_psnr
from tests.evaluation.denoising.noisy_steps import draw_steps, frame_of


@pytest.mark.parametrize("method", [name for name in DENOISERS if name not in (RAW, MASK, OURS)])
def test_every_baseline_reduces_white_noise(method: str) -> None:
    noisy, clean = draw_steps()
    assert measure_psnr(DENOISERS[method](frame_of(noisy), Config()), clean) > measure_psnr(noisy, clean) + 4


@pytest.mark.parametrize("method", DENOISERS)
@pytest.mark.parametrize("value", [0.0, 0.5, 1.0])
def test_every_method_leaves_a_uniform_image_uniform(method: str, value: float) -> None:
    image = np.full((40, 30), value, dtype=np.float32)
    denoised = DENOISERS[method](frame_of(image), Config())
    assert denoised.shape == image.shape and denoised.dtype == np.float32
    expected = np.zeros_like(image) if method == MASK else image
    np.testing.assert_allclose(denoised, expected, atol=0.003)


@pytest.mark.parametrize("method", DENOISERS)
def test_every_method_returns_an_image_and_does_not_modify_its_input(method: str) -> None:
    image = np.random.default_rng(1).choice([0.0, 0.2, 1.0], size=(40, 30)).astype(np.float32)
    before = image.copy()
    image.flags.writeable = False
    denoised = DENOISERS[method](frame_of(image), Config())
    assert denoised.shape == image.shape and denoised.min() >= 0 and denoised.max() <= 1
    np.testing.assert_array_equal(image, before)
