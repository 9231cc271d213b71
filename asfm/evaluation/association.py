"""Association in time: poses of an estimate paired with those of a reference, across no gap."""

from dataclasses import dataclass

import numpy as np

from asfm.diagnostics import frame_runs
from asfm.errors import AsfmError
from asfm.geometry.local_origin import local_origin, shift_poses
from asfm.geometry.poses import interpolate
from asfm.geometry.time_gaps import MAX_GAP_S, longest_bridge_s, measure_gaps, median_interval_s, nearest_stamps
from asfm.types import BoolArray, FloatArray, Trajectory

STAMP_TOLERANCE_S = 1e-3
"""Stamps in text files are rounded: a pose this little outside the reference's time takes the reference's nearest end.
"""
SPARSE_INTERVAL_S = 1.5
"""A reference with a longer median interval is compared at its own stamps alone; one of 1 Hz with jitter is not."""

MAX_SPANS = 4
"""Notes state the times of at most this many spans and count the others."""


@dataclass(frozen=True)
class PosePairs:
    """Poses of an estimate and of a reference at the same stamps, each in its own world."""

    timestamps_s: FloatArray
    """(N,), N >= 2."""
    estimate: FloatArray
    """(N, 4, 4) estimated_world_from_vehicle."""
    reference: FloatArray
    """(N, 4, 4) reference_world_from_vehicle."""

    def __len__(self) -> int:
        return len(self.timestamps_s)


def associate(estimate: Trajectory, reference: Trajectory) -> PosePairs:
    """Pair the poses of the estimate with the reference interpolated (SLERP) there, where it is within reach.

    Nothing is interpolated across a gap of the reference (:func:`within_reach`). A pose of the reference amid such gaps
    is paired with the estimate interpolated at its stamp. Each trajectory is moved to a local origin of its own world.

    Args:
        estimate: world_from_vehicle.
        reference: world_from_vehicle, in any world.

    Raises:
        AsfmError: there are fewer than two pairs, or a pose is not finite.
    """
    for name, trajectory in (("estimate", estimate), ("reference", reference)):
        for row in np.flatnonzero(~np.isfinite(trajectory.world_from_vehicle).all(axis=(1, 2)))[:1]:
            raise AsfmError(f"{name}, pose {row}: expected finite numbers, found nan or inf: remove that pose")
    near = within_reach(estimate.timestamps_s, reference.timestamps_s)
    isolated_s = _isolated_stamps(reference.timestamps_s, estimate.timestamps_s)
    at_s = np.sort(np.concatenate([estimate.timestamps_s[near], isolated_s]))
    if len(at_s) < 2:
        raise AsfmError(
            f"expected two or more poses of the estimate with a reference within reach, found {len(at_s)}: "
            f"the estimate {_span(estimate.timestamps_s)}, the reference {_span(reference.timestamps_s)}; "
            "give both the same clock"
        )
    return PosePairs(at_s, _look_up(estimate, at_s), _look_up(reference, at_s))


def within_reach(at_s: FloatArray, reference_s: FloatArray) -> BoolArray:
    """Return at which of (M,) times a reference with (N,) rising stamps is known.

    It is at its stamps, up to rounding, and between two of them that are at most a second or three of its own median
    intervals apart. A reference whose poses are rarer than :data:`SPARSE_INTERVAL_S` is not interpolated: a vehicle
    does not keep to a straight line for that long.
    """
    if not len(reference_s):
        return np.zeros(len(at_s), dtype=bool)
    nearest_s, gap_s = measure_gaps(reference_s, at_s)
    return np.asarray((nearest_s <= STAMP_TOLERANCE_S) | (gap_s <= _longest_bridge_s(reference_s)))


def describe_coverage(estimate_s: FloatArray, reference_s: FloatArray, pairs: PosePairs) -> list[str]:
    """Say how many poses of the estimate have no reference within reach, and when; nothing where all have."""
    missed = ~within_reach(estimate_s, reference_s)
    if not missed.any():
        return []
    count = len(estimate_s)
    note = (
        f"{count - missed.sum()} of {count} poses have a reference within reach: {describe_spans(missed, estimate_s)} "
    )
    note += "are left out."
    between = len(pairs) - (count - int(missed.sum()))
    return [note + (f" At {between} more stamps of the reference the estimate is interpolated." if between else "")]


def describe_spans(which: BoolArray, timestamps_s: FloatArray) -> str:
    """Format from when to when the chosen (R,) stamps are: "those at 4.500-15.500 s"; later spans are counted."""
    spans = [
        f"{timestamps_s[a]:.3f}" if a == b else f"{timestamps_s[a]:.3f}-{timestamps_s[b]:.3f}"
        for a, b in frame_runs(which)
    ]
    more = f" and in {len(spans) - MAX_SPANS} more spans" if len(spans) > MAX_SPANS else ""
    return f"those at {', '.join(spans[:MAX_SPANS])} s{more}"


def _longest_bridge_s(reference_s: FloatArray) -> float:
    interval_s = median_interval_s(reference_s)
    return longest_bridge_s(interval_s) if interval_s <= SPARSE_INTERVAL_S else MAX_GAP_S


def _isolated_stamps(reference_s: FloatArray, estimate_s: FloatArray) -> FloatArray:
    """Return the stamps (I,) of a reference amid gaps where the estimate has no pose and can be interpolated."""
    if not len(reference_s) or not len(estimate_s):
        return np.zeros(0)
    bridged = np.diff(reference_s) <= _longest_bridge_s(reference_s)
    alone = ~(np.append(bridged, False) | np.append(False, bridged))
    nearest_s, _ = measure_gaps(estimate_s, reference_s)
    return np.asarray(reference_s[alone & within_reach(reference_s, estimate_s) & (nearest_s > STAMP_TOLERANCE_S)])


def _look_up(trajectory: Trajectory, at_s: FloatArray) -> FloatArray:
    """Interpolate a trajectory (M, 4, 4) about its local origin; beside a gap take the pose at the stamp itself."""
    stamps_s, poses = trajectory.timestamps_s, trajectory.world_from_vehicle
    _, gap_s = measure_gaps(stamps_s, at_s)
    beside_gap = gap_s > _longest_bridge_s(stamps_s)
    at_s = np.where(beside_gap, nearest_stamps(stamps_s, at_s), at_s)
    poses = shift_poses(poses, -local_origin(poses[:, :3, 3]))
    found = interpolate(stamps_s, poses, at_s)
    _, own, asked = np.intersect1d(stamps_s, at_s, return_indices=True)
    found[asked] = poses[own]  # to the last digit
    return found


def _span(timestamps_s: FloatArray) -> str:
    if len(timestamps_s) == 0:
        return "has no poses"
    return f"runs from {timestamps_s[0]:.3f} to {timestamps_s[-1]:.3f} s"
