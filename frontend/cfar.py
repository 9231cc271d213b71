"""Constant false-alarm rate detection: which pixels stand out from the noise around them.

A cell is detected where its power exceeds factor * statistic of its reference cells, the factor being such that cells
of exponential power, as the noise of a coherent sonar has, exceed it with the asked probability.
"""

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from asfm.config import CfarConfig
from asfm.errors import AsfmError
from asfm.frontend.threshold_factors import average_factors, look_up_halves, order_factors, order_ranks
from asfm.frontend.windows import as_counts, clip_half, count_ring_below, sum_halves, sum_ring
from asfm.types import BoolArray, FloatArray

Method = Literal["ca", "goca", "soca", "os"]
Noise = Literal["rayleigh", "exponential"]
Power = NDArray[np.float32]


def detect_cfar(
    image: NDArray[np.number],
    valid: BoolArray,
    config: CfarConfig,
    *,
    method: Method = "ca",
    noise: Noise = "rayleigh",
    order_fraction: float = 0.75,
) -> BoolArray:
    """Mark the pixels that stand out from their surroundings further than noise does.

    The reference cells are the window of half-size ``reference_px`` without the one of half-size ``guard_px``; only
    valid cells inside the image count, and the factor is the one for as many as there are. Without any the cell is not
    detected. A window of no columns is one-dimensional along range.

    Methods:
        ca: the mean of all reference cells (Finn and Johnson 1968); best in even noise.
        goca: the greater of the means of the nearer and of the farther rows (Hansen 1973); fewer false alarms where
            the noise steps up.
        soca: the smaller of the two (Trunk 1978); does not lose a target beside another one.
        os: the cell of rank ``order_fraction`` * n (Rohling 1983); holds out against several targets, at some ten
            times the time.

    Args:
        image: (ranges, beams) 0 or more, in any unit; what is not finite counts as invalid.
        valid: (ranges, beams) false where the pixel holds no data; such a pixel is never detected.
        config: probability and windows.
        method: statistic of the reference cells.
        noise: what the image's noise is like: "rayleigh" amplitude, squared to get its power, or "exponential" power.
        order_fraction: rank that ``os`` uses, over 0 to 1.

    Returns:
        (ranges, beams) true where detected.

    Raises:
        AsfmError: the shapes disagree, there is no pixel, or a setting is none of ours.
    """
    _check(image, valid, method, noise, order_fraction)
    usable = np.asarray(valid & np.isfinite(image))
    power = np.asarray(image, dtype=np.float32)
    if not usable.all():
        power = np.where(usable, power, np.float32(0))
    if noise == "rayleigh":
        power = power * power
    # Without reference cells the factor is infinite and the statistic zero: their product compares false.
    with np.errstate(invalid="ignore"):
        if method == "ca":
            detected = _exceeds_average(power, usable, config)
        elif method == "os":
            detected = _exceeds_order(power, usable, config, order_fraction)
        else:
            detected = _exceeds_halves(power, usable, config, greatest=method == "goca")
    return np.asarray(detected & usable)


def _exceeds_average(power: Power, usable: BoolArray, config: CfarConfig) -> BoolArray:
    total = sum_ring(power, config.reference_px, config.guard_px)
    count = sum_ring(as_counts(usable), config.reference_px, config.guard_px).astype(np.intp)
    counts = np.arange(count.max() + 1)
    sum_factors = average_factors(counts, config.false_alarm_probability) / np.maximum(counts, 1)
    return np.asarray(power > sum_factors.take(count) * _not_negative(total))


def _exceeds_halves(power: Power, usable: BoolArray, config: CfarConfig, greatest: bool) -> BoolArray:
    sums = sum_halves(power, config.reference_px, config.guard_px)
    counts = sum_halves(as_counts(usable), config.reference_px, config.guard_px)
    rows, columns = clip_half(config.reference_px, power.shape)
    largest = rows * (2 * columns + 1)
    factor = look_up_halves(*counts, largest, config.false_alarm_probability, greatest)
    means = [_not_negative(total) / np.maximum(count, 1) for total, count in zip(sums, counts, strict=True)]
    if greatest:
        return np.asarray(power > factor * np.maximum(*means))
    for mean, count in zip(means, counts, strict=True):
        mean[count == 0] = np.inf  # a half without cells is not the smaller one
    return np.asarray(power > factor * np.minimum(*means))


def _exceeds_order(power: Power, usable: BoolArray, config: CfarConfig, order_fraction: float) -> BoolArray:
    count = sum_ring(as_counts(usable), config.reference_px, config.guard_px).astype(np.intp)
    counts = np.arange(count.max() + 1)
    factors = order_factors(counts, config.false_alarm_probability, order_fraction)
    # The cell of rank k lies below the limit where k cells do: nothing has to be sorted.
    limit = (power / factors.take(count)).astype(np.float32)
    reference = power if usable.all() else np.where(usable, power, np.float32(np.inf))
    below = count_ring_below(reference, limit, config.reference_px, config.guard_px)
    return np.asarray(below >= order_ranks(counts, order_fraction).take(count))


def _not_negative(total: FloatArray) -> FloatArray:
    """Undo what running sums may leave over where there is nothing."""
    return np.maximum(total, 0.0, out=total)


def _check(image: NDArray[np.number], valid: BoolArray, method: Method, noise: Noise, order_fraction: float) -> None:
    if image.ndim != 2 or image.shape != valid.shape or image.size == 0:
        raise AsfmError(
            f"CFAR: expected an image (ranges, beams) and a validity mask of its shape, "
            f"found {image.shape} and {valid.shape}"
        )
    for name, value, known in (("method", method, get_args(Method)), ("noise", noise, get_args(Noise))):
        if value not in known:
            raise AsfmError(f"CFAR: expected a {name} of {', '.join(known)}; found {value!r}")
    if not 0 < order_fraction <= 1:
        raise AsfmError(f"CFAR: expected an order_fraction over 0 and up to 1, found {order_fraction}")
