"""Constant false-alarm rate detection: which pixels stand out from the noise around them.

The detectors are made for exponentially distributed power. An imaging sonar's grey value is an amplitude, Rayleigh
distributed in noise, whose square is such a power.
"""

import numpy as np
from asfm.config import CfarConfig
from asfm.errors import AsfmError
from asfm.frontend.windows import count_box, sum_box
from asfm.types import BoolArray, FloatArray
from numpy.typing import NDArray


def detect_cfar(image: NDArray[np.number], valid: BoolArray, config: CfarConfig) -> BoolArray:
    """Mark the pixels that stand out from their surroundings further than noise does.

    A cell of power p is detected where p > n (P^(-1/n) - 1) * mean of its n reference cells: the window of half-size
    ``reference_px`` without the one of half-size ``guard_px``, counting only valid cells inside the image. P is the
    false-alarm probability. A cell without any reference cell is not detected.

    Args:
        image: (ranges, beams) amplitude, 0 or more, in any unit; what is not finite counts as invalid.
        valid: (ranges, beams) false where the pixel holds no data; such a pixel is never detected.
        config: probability and windows.

    Returns:
        (ranges, beams) true where detected.

    Raises:
        AsfmError: the shapes disagree or there is no pixel.
    """
    _check(image, valid)
    usable = np.asarray(valid & np.isfinite(image))
    amplitude = np.asarray(image, dtype=np.float32)
    if not usable.all():
        amplitude = np.where(usable, amplitude, np.float32(0))
    power = amplitude * amplitude
    total = sum_box(power, config.reference_px) - sum_box(power, config.guard_px)
    count = count_box(usable, config.reference_px) - count_box(usable, config.guard_px)
    factor = _sum_factors(int(count.max(initial=0)), config.false_alarm_probability)
    return np.asarray((power > factor[count] * np.maximum(total, 0.0)) & usable & (count > 0))


def _sum_factors(largest: int, probability: float) -> FloatArray:
    """Threshold over the sum of n = 0..largest reference cells: P^(-1/n) - 1; zero for n = 0."""
    factors = np.zeros(largest + 1)
    factors[1:] = np.expm1(-np.log(probability) / np.arange(1, largest + 1))
    return factors


def _check(image: NDArray[np.number], valid: BoolArray) -> None:
    if image.ndim != 2 or image.shape != valid.shape or image.size == 0:
        raise AsfmError(
            f"CFAR: expected an image (ranges, beams) and a validity mask of its shape, "
            f"found {image.shape} and {valid.shape}"
        )
