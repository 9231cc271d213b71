"""Jumps, held poses and zeros in a reference trajectory, as trackers and their exporters write while they are lost.

A pose of the reference is left out only where the reference contradicts itself: a step that its neighbours do not
explain, a pose repeated to the last digit, or a position of exactly zero. The estimate is the second witness and never
the first, so that its own errors are not taken off the comparison.
"""

import numpy as np

from asfm.diagnostics import frame_runs
from asfm.evaluation.association import describe_spans, within_reach
from asfm.evaluation.paired_motions import (
    JUMP_FACTOR,
    MIN_JUMP,
    PairedMotions,
    jumping_steps,
    motion_lengths,
    step_vectors,
)
from asfm.geometry.poses import interpolate
from asfm.navigation.outlier_filter import MIN_READINGS
from asfm.types import BoolArray, FloatArray, Trajectory

HELD_SHARE = 0.5
"""A pose is held where the estimate moves on at this share of its mean speed, or more."""
MAX_SEGMENTS = 400
"""A reference with more jumps than this is noise: it is not taken apart."""


def clean_reference(reference: Trajectory, estimate: Trajectory) -> tuple[Trajectory, tuple[str, ...]]:
    """Leave out the poses of a reference that were not measured.

    Args:
        reference: world_from_vehicle in any world; poses may be NaN where the tracker was lost.
        estimate: world_from_vehicle in any world.

    Returns:
        The other poses, and a sentence for each kind of fault: how many poses, when, and how far off.
    """
    notes = list[str]()
    finite = np.asarray(np.isfinite(reference.world_from_vehicle).all(axis=(1, 2)))
    kept = finite.copy()
    if not finite.all():
        notes.append(f"{_describe(~finite, reference.timestamps_s)} are not finite: left out.")
    tested = finite & within_reach(reference.timestamps_s, estimate.timestamps_s)
    index = np.flatnonzero(tested)
    if len(index) > MIN_READINGS:
        at_s = reference.timestamps_s[index]
        motions = PairedMotions(
            at_s,
            reference.world_from_vehicle[index],
            interpolate(estimate.timestamps_s, estimate.world_from_vehicle, at_s),
        )
        for find in (_find_zeros, _find_held, _find_jumped):
            remaining = kept[index]
            if remaining.sum() <= MIN_READINGS:
                break
            wrong = np.zeros(len(index), dtype=bool)
            wrong[remaining], reason = find(motions.select(remaining))
            if reason:
                notes.append(reason.format(_describe(wrong, at_s)))
            kept[index[wrong]] = False
    return Trajectory(reference.timestamps_s[kept], reference.world_from_vehicle[kept]), tuple(notes)


def _describe(which: BoolArray, timestamps_s: FloatArray) -> str:
    return f"{which.sum()} of {len(which)} poses of the reference, {describe_spans(which, timestamps_s)},"


def _find_zeros(motions: PairedMotions) -> tuple[BoolArray, str]:
    """Find positions of exactly zero that are far from the poses before and after them."""
    zero = (motions.reference[:, :3, 3] == 0).all(axis=1)
    others = np.flatnonzero(~zero)
    wrong = np.zeros(len(zero), dtype=bool)
    if not zero.any() or len(others) <= MIN_READINGS:
        return wrong, ""
    noise = motions.select(~zero).noise()
    typical_m = float(np.median(np.linalg.norm(step_vectors(motions.reference[others])[0], axis=1)))
    for first, last in frame_runs(zero):
        for row, beside in ((first, first - 1), (last, last + 1)):
            if 0 <= beside < len(zero) and np.linalg.norm(motions.reference[beside, :3, 3]) > JUMP_FACTOR * typical_m:
                wrong[first : last + 1] |= motions.contradict(row, beside, noise)
    return wrong, "{} are at zero, far from the others, as while a tracker is lost: left out." if wrong.any() else ""


def _find_held(motions: PairedMotions) -> tuple[BoolArray, str]:
    """Find poses repeated while the estimate moves on, before or after a jump; the first of them was measured."""
    same = (np.diff(motions.reference, axis=0) == 0).all(axis=(1, 2))
    wrong, unexplained = np.zeros(len(motions.reference), dtype=bool), np.zeros(len(motions.reference), dtype=bool)
    jump, noise = (jumping_steps(motions), motions.noise()) if same.any() else (same, np.zeros(2))
    speed = np.linalg.norm(step_vectors(motions.estimate), axis=2).sum(axis=1) / np.ptp(motions.timestamps_s)
    for first, step in frame_runs(same):
        last = step + 1
        moved = np.max([motion_lengths(motions.estimate, first, row) for row in range(first + 1, last + 1)], axis=0)
        lasted_s = motions.timestamps_s[last] - motions.timestamps_s[first]
        if not np.any(moved > np.maximum(HELD_SHARE * speed * lasted_s, MIN_JUMP)):
            continue
        if (first > 0 and jump[first - 1]) or (last < len(jump) and jump[last]):
            measured_before = np.flatnonzero(~wrong[:first]).tolist()
            witness = measured_before[-1] if measured_before else min(last + 1, len(wrong) - 1)
            measured = not motions.contradict(witness, first, noise)
            wrong[first + measured : last + 1] = True
        else:
            unexplained[first : last + 1] = True
    if wrong.any():
        return wrong, "{} repeat one pose while the estimate moves, beside a jump: left out."
    if unexplained.any():
        where = _describe(unexplained, motions.timestamps_s)
        return wrong, f"{where} repeat one pose while the estimate moves; they are compared, since no jump follows."
    return wrong, ""


def _find_jumped(motions: PairedMotions) -> tuple[BoolArray, str]:
    """Find the poses between jumps that do not continue the others: the longest chain of segments is kept."""
    jump = jumping_steps(motions)
    wrong = np.zeros(len(motions.reference), dtype=bool)
    if not jump.any() or jump.sum() > MAX_SEGMENTS:
        return (
            wrong,
            f"The reference jumps at {jump.sum()} of {len(jump)} steps: they are compared as they are."
            if jump.any()
            else "",
        )
    size = np.linalg.norm(step_vectors(motions.reference), axis=2)[:, jump].max(axis=1)
    edges = np.concatenate([[0], np.flatnonzero(jump) + 1, [len(wrong)]])
    segments = list(zip(edges[:-1].tolist(), (edges[1:] - 1).tolist(), strict=True))
    noise, best = motions.noise(), list[tuple[int, int]]()
    for number, (first, last) in enumerate(segments):
        linked = [
            (best[before][0], before)
            for before in range(number - 1)
            if not motions.contradict(segments[before][1], first, noise)
        ]
        length, previous = max(linked, default=(0, -1))
        best.append((length + last - first + 1, previous))
    wrong[:] = True
    at = max(range(len(best)), key=lambda number: best[number][0])
    while at >= 0:
        wrong[segments[at][0] : segments[at][1] + 1] = False
        at = best[at][1]
    return wrong, f"{{}} lie beyond jumps of up to {size[0]:.2f} m and {np.rad2deg(size[1]):.0f} deg: left out."
