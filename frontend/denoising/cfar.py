"""Constant false-alarm rate detection: which pixels stand out from the noise around them.

A cell is detected where its power exceeds factor * statistic of its reference cells, the factor being such that cells
of exponential power, as the noise of a coherent sonar has, exceed it with the asked probability.
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
"""Share of pixels at the image's least value from which on it is where noise was cut off, not the noise's own least."""


def detect_cfar(image: NDArray[np.number], valid: BoolArray, config: CfarConfig) -> BoolArray:
    """Mark the pixels that stand out from their surroundings further than noise does.

    The reference cells are the window of half-size ``reference_px`` without the one of half-size ``guard_px``; only
    valid cells inside the image count, and the factor is the one for as many as there are. Without any the cell is not
    detected. A window of no columns is one-dimensional along range.

    Methods (``config.method``):
        ca: the mean of all reference cells (Finn and Johnson 1968); best in even noise.
        goca: the greater of the means of the nearer and of the farther rows (Hansen 1973); fewer false alarms where
            the noise steps up.
        soca: the smaller of the two (Trunk 1978); does not lose a target beside another one.
        os: the cell of rank ``order_fraction`` * n (Rohling 1983); holds out against several targets, at some ten
            times the time.

    Noise (``config.noise``):
        rayleigh: amplitude, squared to get its power.
        exponential: power.
        weibull: either of them to an unknown power, which is estimated (see ``speckle``). Pixels at the image's least
            value, where they are many, are noise that was cut off: they tell how often noise exceeds zero, and no more.

    Args:
        image: (ranges, beams) 0 or more, in any unit; what is not finite counts as invalid.
        valid: (ranges, beams) false where the pixel holds no data; such a pixel is never detected.
        config: method, noise, probability and windows.

    Returns:
        (ranges, beams) true where detected.

    Raises:
        AsfmError: the shapes disagree or there is no pixel.
    """
    _check(image, valid)
    usable = np.asarray(valid & np.isfinite(image))
    values = np.asarray(image, dtype=np.float32)
    if not usable.all():
        values = np.where(usable, values, np.float32(0))
    if config.noise == "weibull":
        return _detect_of_shape(values, usable, config)
    power = values * values if config.noise == "rayleigh" else values
    return np.asarray(_exceeds(power, usable, config, None) & usable)


def _detect_of_shape(values: Power, usable: BoolArray, config: CfarConfig) -> BoolArray:
    """Detect in noise of unknown shape, from which the least values may have been cut off."""
    everywhere = bool(usable.all())
    floor = (values if everywhere else np.where(usable, values, np.float32(np.inf))).min()
    above = values > floor if everywhere else usable & (values > floor)
    if np.count_nonzero(above) > (1 - MIN_FLOOR_SHARE) * np.count_nonzero(usable):
        return np.asarray(_exceeds(transform_to_exponential(values, usable), usable, config, None) & usable)
    correction = _censoring_correction(above, usable, config)
    detected = _exceeds(transform_to_exponential(values, above), above, config, correction) | (correction <= 0)
    return np.asarray(detected & above)


def _censoring_correction(above: BoolArray, usable: BoolArray, config: CfarConfig) -> Power:
    """Find what the factors shrink to where only the share q of the reference cells is above the floor. (R, B).

    The asked probability P is that of a cell of any value, so among those above the floor it is P / q. Factors grow as
    its logarithm, but for few cells. Where q is P or less, every cell above the floor is rare enough.
    """
    counts = [count_reference_cells(mask, config.reference_px, config.guard_px) for mask in (above, usable)]
    with np.errstate(divide="ignore", invalid="ignore"):
        logarithm = np.log(np.arange(counts[1].max() + 1)).astype(np.float32)
        logarithm[0] = -np.inf
        share = logarithm.take(counts[0]) - logarithm.take(counts[1])
    correction = np.maximum(1 - share / np.float32(math.log(config.false_alarm_probability)), 0)
    return np.where(counts[1] > 0, correction, np.float32(1))


def _exceeds(power: Power, usable: BoolArray, config: CfarConfig, correction: Power | None) -> BoolArray:
    """Compare exponential power with factor * statistic, the factor times the correction where there is one."""
    # Without reference cells the factor is infinite and the statistic zero: their product compares false.
    with np.errstate(invalid="ignore", divide="ignore"):
        if config.method == "ca":
            return _exceeds_ca(power, usable, config, correction)
        if config.method == "os":
            return _exceeds_os(power, usable, config, correction)
        return _exceeds_goca_soca(power, usable, config, correction)


def _exceeds_ca(power: Power, usable: BoolArray, config: CfarConfig, correction: Power | None) -> BoolArray:
    total = sum_reference_cells(power, config.reference_px, config.guard_px)
    (weight,) = _weigh(usable, config)
    limit = np.multiply(_not_negative(total), weight, out=total)
    if correction is not None:
        limit *= correction
    return np.asarray(power > limit)


def _exceeds_goca_soca(power: Power, usable: BoolArray, config: CfarConfig, correction: Power | None) -> BoolArray:
    sums = sum_leading_lagging(power, config.reference_px, config.guard_px)  # both may share memory
    before, behind = (_not_negative(total) * weight for total, weight in zip(sums, _weigh(usable, config), strict=True))
    # A half without cells has no number: the smaller one is the other.
    limit = (np.maximum if config.method == "goca" else np.fmin)(before, behind)
    if correction is not None:
        limit *= correction
    return np.asarray(power > limit)


def _weigh(usable: BoolArray, config: CfarConfig) -> tuple[FloatArray, ...]:
    """Find what the sums over the reference cells are multiplied by: (R, B) for all cells, or for each of two halves.

    In images without a gap it is the same from frame to frame, and kept.
    """
    settings = (config.reference_px, config.guard_px, config.false_alarm_probability)
    if usable.all():
        return _weigh_full(usable.shape, config.method, *settings)
    return _weigh_counts(usable, config.method, *settings)


@lru_cache(maxsize=4)
def _weigh_full(
    shape: tuple[int, ...], method: str, reference_px: HalfSize, guard_px: HalfSize, probability: float
) -> tuple[FloatArray, ...]:
    weights = _weigh_counts(np.ones(shape, dtype=bool), method, reference_px, guard_px, probability)
    for weight in weights:
        weight.flags.writeable = False
    return weights


def _weigh_counts(
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
    # Without cells the one half leaves the choice to the other, and both, of infinite factor, detect nothing.
    empty = np.where(np.isinf(factor), np.inf, 0.0) if greatest else np.inf
    return tuple(np.where(count > 0, factor / np.maximum(count, 1), empty) for count in halves)


def _exceeds_os(power: Power, usable: BoolArray, config: CfarConfig, correction: Power | None) -> BoolArray:
    count = count_reference_cells(usable, config.reference_px, config.guard_px)
    counts = np.arange(count.max() + 1)
    factor = os_factors(counts, config.false_alarm_probability, config.order_fraction).take(count)
    if correction is not None:
        factor *= correction
    # The cell of rank k lies below the limit where k cells do: nothing has to be sorted.
    limit = (power / factor).astype(np.float32)
    reference = power if usable.all() else np.where(usable, power, np.float32(np.inf))
    below = count_ring_below(reference, limit, config.reference_px, config.guard_px)
    return np.asarray(below >= order_ranks(counts, config.order_fraction).take(count))


def _not_negative(total: FloatArray) -> FloatArray:
    """Undo what running sums may leave over where there is nothing."""
    return np.maximum(total, 0.0, out=total)


def _check(image: NDArray[np.number], valid: BoolArray) -> None:
    if image.ndim != 2 or image.shape != valid.shape or image.size == 0:
        raise AsfmError(
            f"CFAR: expected an image (ranges, beams) and a validity mask of its shape, "
            f"found {image.shape} and {valid.shape}"
        )
