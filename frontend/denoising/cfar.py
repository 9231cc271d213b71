"""Constant false-alarm rate (CFAR) detection: CA-, GOCA-, SOCA- and OS-CFAR on 2-D windows.

The cell under test is detected where its power exceeds factor * statistic of its reference (training) cells. The factor
gives the configured false-alarm probability in exponentially distributed noise power, the noise of a coherent sonar.
"""

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from asfm.config import CfarConfig
from asfm.errors import AsfmError
from asfm.frontend.denoising.cfar_factors import ca_factors, lookup_goca_soca_factors, order_ranks, os_factors
from asfm.frontend.denoising.cfar_windows import (
    HalfSize,
    clip_half,
    count_leading_lagging,
    count_reference_cells,
    count_ring_below,
    sum_leading_lagging,
    sum_reference_cells,
)
from asfm.frontend.denoising.weibull import transform_to_exponential
from asfm.types import BoolArray, FloatArray

Power = NDArray[np.float32]

MIN_FLOOR_SHARE = 0.01
"""From this share of pixels at the image's minimum on, the noise is treated as left-censored at that value."""


def detect_cfar(image: NDArray[np.number], valid: BoolArray, config: CfarConfig) -> BoolArray:
    """Detect the pixels that exceed the CFAR threshold of their reference cells.

    The reference cells are the window of half-size ``reference_px`` without the guard cells (half-size ``guard_px``).
    Only valid cells inside the image count, and the factor is that for their number; without any, nothing is detected.
    With half-sizes of 0 columns the window is one-dimensional along range.

    Methods (``config.method``):
        ca: cell averaging, the mean of all reference cells (Finn and Johnson 1968); best in homogeneous noise.
        goca: greatest of the means of the leading (nearer) and the lagging (farther) window (Hansen 1973); fewer false
            alarms at clutter edges.
        soca: smallest of the two means (Trunk 1978); robust against target masking by an interfering target.
        os: ordered statistic, the cell of rank ``order_fraction`` * n (Rohling 1983); robust against several
            interfering targets, about ten times slower.

    Noise (``config.noise``):
        rayleigh: pixels are amplitudes, squared to get power.
        exponential: pixels are powers.
        weibull: Weibull clutter of a shape estimated from the image (see ``weibull``), left-censored where many pixels
            are at the image's minimum.

    Args:
        image: (ranges, beams) non-negative pixels in any unit; non-finite ones count as invalid.
        valid: (ranges, beams) false where the pixel holds no data; such a pixel is never detected.
        config: method, noise, false-alarm probability and windows.

    Returns:
        (ranges, beams) true where detected.

    Raises:
        AsfmError: the shapes disagree or the image is empty.
    """
    _check_shapes(image, valid)
    usable = np.asarray(valid & np.isfinite(image))
    values = np.asarray(image, dtype=np.float32)
    if not usable.all():
        values = np.where(usable, values, np.float32(0))
    return _detect_usable(values, usable, config)


def _detect_usable(values: Power, usable: BoolArray, config: CfarConfig) -> BoolArray:
    """Detect in finite pixels, 0 where not usable."""
    if config.noise == "weibull":
        return _detect_weibull(values, usable, config)
    power = values * values if config.noise == "rayleigh" else values
    return np.asarray(_exceeds_threshold(power, usable, config, None) & usable)


def _detect_weibull(values: Power, usable: BoolArray, config: CfarConfig) -> BoolArray:
    """Detect in Weibull clutter of unknown shape, left-censored if many pixels are at the minimum."""
    all_usable = bool(usable.all())
    floor = (values if all_usable else np.where(usable, values, np.float32(np.inf))).min()
    above = values > floor if all_usable else usable & (values > floor)
    if np.count_nonzero(above) > (1 - MIN_FLOOR_SHARE) * np.count_nonzero(usable):
        return np.asarray(_exceeds_threshold(transform_to_exponential(values, usable), usable, config, None) & usable)
    correction = _censoring_correction(above, usable, config)
    power = transform_to_exponential(values, above)
    detected = _exceeds_threshold(power, above, config, correction) | (correction <= 0)
    return np.asarray(detected & above)


def _censoring_correction(above: BoolArray, usable: BoolArray, config: CfarConfig) -> Power:
    """Compute the threshold correction for left-censored noise: (ranges, beams) multipliers of the factor in 0..1.

    With a share q of the reference cells above the floor, the false-alarm probability P of any cell is P / q among the
    cells above it. The factor is proportional to -log P, except for few cells. Where q <= P every cell above the floor
    is a detection.
    """
    counts = [count_reference_cells(mask, config.reference_px, config.guard_px) for mask in (above, usable)]
    with np.errstate(divide="ignore", invalid="ignore"):
        logarithm = np.log(np.arange(counts[1].max() + 1)).astype(np.float32)
        logarithm[0] = -np.inf
        log_share = logarithm.take(counts[0]) - logarithm.take(counts[1])
    correction = np.maximum(1 - log_share / np.float32(math.log(config.false_alarm_probability)), 0)
    return np.where(counts[1] > 0, correction, np.float32(1))


def _exceeds_threshold(power: Power, usable: BoolArray, config: CfarConfig, correction: Power | None) -> BoolArray:
    """Compare exponential power with factor * statistic; the factor is multiplied by the correction, if given."""
    # Without reference cells the factor is infinite and the statistic zero: their product compares false.
    with np.errstate(invalid="ignore", divide="ignore"):
        if config.method == "ca":
            return _exceeds_ca(power, usable, config, correction)
        if config.method == "os":
            return _exceeds_os(power, usable, config, correction)
        return _exceeds_goca_soca(power, usable, config, correction)


def _exceeds_ca(power: Power, usable: BoolArray, config: CfarConfig, correction: Power | None) -> BoolArray:
    total = sum_reference_cells(power, config.reference_px, config.guard_px)
    (weight,) = _sum_weights(usable, config)
    threshold = np.multiply(_clip_negative(total), weight, out=total)
    if correction is not None:
        threshold *= correction
    return np.asarray(power > threshold)


def _exceeds_goca_soca(power: Power, usable: BoolArray, config: CfarConfig, correction: Power | None) -> BoolArray:
    sums = sum_leading_lagging(power, config.reference_px, config.guard_px)  # both may share memory
    leading, lagging = (
        _clip_negative(total) * weight for total, weight in zip(sums, _sum_weights(usable, config), strict=True)
    )
    # An empty half-window is NaN: fmin returns the other half.
    threshold = (np.maximum if config.method == "goca" else np.fmin)(leading, lagging)
    if correction is not None:
        threshold *= correction
    return np.asarray(power > threshold)


def _sum_weights(usable: BoolArray, config: CfarConfig) -> tuple[FloatArray, ...]:
    """Compute factor / count, the (ranges, beams) weight of the reference sum, one for CA, two for GOCA and SOCA.

    Images without invalid pixels share the same weights, which are cached.
    """
    settings = (config.reference_px, config.guard_px, config.false_alarm_probability)
    if usable.all():
        return _cached_weights(usable.shape, config.method, *settings)
    return _weights_from_counts(usable, config.method, *settings)


@lru_cache(maxsize=4)
def _cached_weights(
    shape: tuple[int, ...], method: str, reference_px: HalfSize, guard_px: HalfSize, probability: float
) -> tuple[FloatArray, ...]:
    weights = _weights_from_counts(np.ones(shape, dtype=bool), method, reference_px, guard_px, probability)
    for weight in weights:
        weight.flags.writeable = False
    return weights


def _weights_from_counts(
    usable: BoolArray, method: str, reference_px: HalfSize, guard_px: HalfSize, probability: float
) -> tuple[FloatArray, ...]:
    if method == "ca":
        count = count_reference_cells(usable, reference_px, guard_px)
        counts = np.arange(count.max() + 1)
        return (np.asarray((ca_factors(counts, probability) / np.maximum(counts, 1)).take(count)),)
    halves = count_leading_lagging(usable, reference_px, guard_px)
    rows, columns = clip_half(reference_px, usable.shape)
    greatest = method == "goca"
    factor = lookup_goca_soca_factors(*halves, rows * (2 * columns + 1), probability, greatest)
    # An empty half-window must not win the comparison; two empty ones, of infinite factor, must detect nothing.
    empty = np.where(np.isinf(factor), np.inf, 0.0) if greatest else np.inf
    return tuple(np.where(count > 0, factor / np.maximum(count, 1), empty) for count in halves)


def _exceeds_os(power: Power, usable: BoolArray, config: CfarConfig, correction: Power | None) -> BoolArray:
    count = count_reference_cells(usable, config.reference_px, config.guard_px)
    counts = np.arange(count.max() + 1)
    factor = os_factors(counts, config.false_alarm_probability, config.order_fraction).take(count)
    if correction is not None:
        factor *= correction
    # The cell of rank k is below power / factor where at least k cells are: no sorting is needed.
    limit = (power / factor).astype(np.float32)
    reference = power if usable.all() else np.where(usable, power, np.float32(np.inf))
    below = count_ring_below(reference, limit, config.reference_px, config.guard_px)
    return np.asarray(below >= order_ranks(counts, config.order_fraction).take(count))


def _clip_negative(total: FloatArray) -> FloatArray:
    """Set to zero, in place, the negative rounding residue that running sums leave where the true sum is zero."""
    return np.maximum(total, 0.0, out=total)


def _check_shapes(image: NDArray[np.number], valid: BoolArray) -> None:
    if image.ndim != 2 or image.shape != valid.shape or image.size == 0:
        raise AsfmError(
            f"CFAR: expected a non-empty image (ranges, beams) and a validity mask of the same shape, "
            f"found the shapes {image.shape} and {valid.shape}"
        )
