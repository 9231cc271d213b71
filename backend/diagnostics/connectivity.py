"""Connectivity: which consecutive frames share enough landmarks, and a warning of the steps that do not."""

import numpy as np

from asfm.backend.estimation.solution import Solution
from asfm.config import Config
from asfm.diagnostics import Diagnostic, format_runs, step_runs
from asfm.sequence import Sequence
from asfm.types import BoolArray

MIN_LINKS = 3
"""Landmarks that the parts of a trajectory before and after a step must share to count as connected."""


def warn_of_disconnected_steps(sequence: Sequence, solution: Solution, config: Config) -> tuple[Diagnostic, ...]:
    """Report the steps between consecutive frames that fewer than :data:`MIN_LINKS` landmarks span.

    Args:
        sequence: N frames.
        solution: tracks and the observations used.
        config: whether odometry is used.
    """
    if len(sequence) == 1:
        return (Diagnostic("single-frame", "the sequence has one frame: nothing to reconstruct, its pose is held"),)
    disconnected = ~connected_steps(solution, len(sequence))
    if not disconnected.any():
        return ()
    runs = step_runs(disconnected)
    substitute = "odometry" if sequence.odometry is not None and config.backend.use_odometry else "the last pose"
    if disconnected.all():
        message = f"no two frames share {MIN_LINKS} landmarks: all {len(sequence)} poses are held by {substitute}"
    else:
        message = (
            f"{int(disconnected.sum())} of {len(disconnected)} steps are not supported by the sonar (fewer than "
            f"{MIN_LINKS} shared landmarks): the poses are held by {substitute} between frames {format_runs(runs)}"
        )
    return (Diagnostic("unsupported-steps", message, runs),)


def connected_steps(solution: Solution, frame_count: int) -> BoolArray:
    """Find the steps that at least :data:`MIN_LINKS` landmarks span, with observations used before and after.

    Args:
        solution: tracks and the observations used.
        frame_count: N.

    Returns:
        (N - 1,) whether each step from a frame to the next is connected.
    """
    used = solution.observed
    track, frame = solution.tracks.track[used], solution.tracks.frame[used]
    if not len(track):
        return np.zeros(max(frame_count - 1, 0), dtype=bool)
    begins = np.flatnonzero(np.diff(track, prepend=-1))
    ends = np.append(begins[1:], len(track)) - 1
    change = np.bincount(frame[begins], minlength=frame_count) - np.bincount(frame[ends], minlength=frame_count)
    return np.asarray(np.cumsum(change)[:-1] >= MIN_LINKS)
