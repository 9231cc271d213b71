"""Offset between the clocks of an estimate and of a reference, found by the trajectory error at shifted stamps."""

import numpy as np

from asfm.errors import AsfmError
from asfm.evaluation.association import associate
from asfm.evaluation.trajectory import absolute_errors, align_se3, summarise
from asfm.geometry.time_gaps import median_interval_s
from asfm.types import Trajectory

MAX_SHIFT_STEPS = 12
"""Shifts of up to this many intervals of the estimate are tried, in both directions."""
BETTER_FIT = 0.3
"""A shift counts where it brings the error below this share of what it is without."""
MIN_ERROR_M = 1e-3
"""Smaller errors are not explained by anything."""


def describe_clock_offset(estimate: Trajectory, reference: Trajectory) -> list[str]:
    """Say by how much the stamps of a reference seem to be shifted; nothing where no shift fits much better.

    Args:
        estimate: world_from_vehicle.
        reference: world_from_vehicle, in any world.
    """
    recorded_m = _error_m(estimate, reference, 0.0)
    if not MIN_ERROR_M < recorded_m < np.inf:
        return []
    step_s = median_interval_s(estimate.timestamps_s)
    shifts_s = step_s * np.arange(-MAX_SHIFT_STEPS, MAX_SHIFT_STEPS + 1)
    errors_m = [_error_m(estimate, reference, float(shift_s)) for shift_s in shifts_s]
    best = int(np.argmin(errors_m))
    if not errors_m[best] < BETTER_FIT * recorded_m:
        return []
    return [
        f"With the reference's stamps shifted by {shifts_s[best]:+.3g} s the ATE would be {errors_m[best]:.3g} m "
        f"instead of {recorded_m:.3g} m: give both the same clock."
    ]


def _error_m(estimate: Trajectory, reference: Trajectory, shift_s: float) -> float:
    """Return the ATE with shifted stamps of the reference; infinite where half of the poses find none."""
    try:
        pairs = associate(estimate, Trajectory(reference.timestamps_s + shift_s, reference.world_from_vehicle))
    except AsfmError:
        return np.inf
    if 2 * len(pairs) < min(len(estimate.timestamps_s), len(reference.timestamps_s)):
        return np.inf
    aligned = align_se3(pairs.estimate, pairs.reference) @ pairs.estimate
    return summarise(absolute_errors(aligned, pairs.reference)[0]).rmse
