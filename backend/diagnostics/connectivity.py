"""What the poses rest on: which frames the sonar tied together, and what held the others."""

import numpy as np

from asfm.backend.estimation.solution import Solution
from asfm.config import Config
from asfm.diagnostics import Diagnostic, format_runs, step_runs
from asfm.sequence import Sequence
from asfm.types import BoolArray

MIN_LINKS = 3
"""Fewest landmarks that two parts of a trajectory must share to be tied together."""


def warn_of_disconnected_steps(sequence: Sequence, solution: Solution, config: Config) -> tuple[Diagnostic, ...]:
    """Report the steps between consecutive frames that too few landmarks span."""
    if len(sequence) == 1:
        return (Diagnostic("single-frame", "the sequence has one frame: nothing to reconstruct, its pose is held"),)
    loose = ~connected_steps(solution, len(sequence))
    if not loose.any():
        return ()
    runs = step_runs(loose)
    stand_in = "odometry" if sequence.odometry is not None and config.backend.use_odometry else "the last pose"
    if loose.all():
        message = f"no two frames share {MIN_LINKS} landmarks: all {len(sequence)} poses are held by {stand_in}"
    else:
        message = (
            f"{int(loose.sum())} of {len(loose)} steps are not supported by the sonar (fewer than {MIN_LINKS} shared "
            f"landmarks): the poses are held by {stand_in} between frames {format_runs(runs)}"
        )
    return (Diagnostic("unsupported-steps", message, runs),)


def connected_steps(solution: Solution, frame_count: int) -> BoolArray:
    """Tell which steps from a frame to the next are spanned by enough landmarks: (N - 1,).

    A landmark spans a step when it is used both before and after it.
    """
    used = solution.observed
    track, frame = solution.tracks.track[used], solution.tracks.frame[used]
    if not len(track):
        return np.zeros(max(frame_count - 1, 0), dtype=bool)
    begins = np.flatnonzero(np.diff(track, prepend=-1))
    ends = np.append(begins[1:], len(track)) - 1
    change = np.bincount(frame[begins], minlength=frame_count) - np.bincount(frame[ends], minlength=frame_count)
    return np.asarray(np.cumsum(change)[:-1] >= MIN_LINKS)
