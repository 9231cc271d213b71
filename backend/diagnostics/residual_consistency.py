"""Residual consistency: residuals of odometry, depth, attitude and sonar against their stated noise (chi-square)."""

import numpy as np

from asfm.backend.diagnostics.linearised_residuals import ResidualBlock
from asfm.consistency import ResidualStatistics
from asfm.diagnostics import FrameRuns, frame_runs
from asfm.types import BoolArray, FloatArray

STRETCH_FRAMES = 10
"""Statistics are taken over stretches of this many frames, one beginning at each frame."""
MAX_MEAN_SQUARE = 2.5
"""A stretch is inconsistent beyond this chi-square per degree of freedom."""
MAX_SUM = 4.0
"""A stretch is inconsistent where the sum of a channel's residuals exceeds this many of its standard deviations."""
CHANNELS: dict[str, dict[str, slice]] = {
    "odometry": {"odometry rotation": slice(0, 3), "odometry translation": slice(3, 6)},
    "depth and attitude": {"depth": slice(0, 1), "attitude": slice(1, 3)},
    "sonar": {"sonar range": slice(0, 1), "sonar bearing": slice(1, 2)},
}
"""Names of the channels whose residuals are tested together, by sensor."""


def measure_residuals(blocks: tuple[ResidualBlock, ...], frame_count: int) -> tuple[ResidualStatistics, ...]:
    """Compare the residuals of each sensor with their stated noise.

    At the optimum residuals are smaller than the noise of the measurements, by the degrees of freedom that the fit
    takes: the mean square is 1 or less where what is stated is right.

    Args:
        blocks: residuals of all sensors at the optimum.
        frame_count: N.
    """
    return tuple(
        _measure_channel(name, block, channel, frame_count)
        for block in blocks
        for name, channel in CHANNELS[block.sensor].items()
    )


def _measure_channel(name: str, block: ResidualBlock, channel: slice, frame_count: int) -> ResidualStatistics:
    measured = block.weight[:, channel] > 0
    residual = np.where(measured, block.residual[:, channel], 0.0)
    count = _by_frame(block, measured.astype(float), frame_count)
    counts = np.maximum(_sum_stretches(count), 1.0)
    squares = _by_frame(block, residual**2, frame_count)
    mean_square = (_sum_stretches(squares) / counts).max(axis=1)
    sums = np.abs(_sum_stretches(_by_frame(block, residual, frame_count)) / np.sqrt(counts)).max(axis=1)
    worst = int(np.argmax(mean_square))
    return ResidualStatistics(
        sensor=name,
        mean_square=float(squares.sum() / max(count.sum(), 1.0)),
        worst_mean_square=float(mean_square[worst]),
        worst_sum=float(sums.max()),
        worst_frames=(worst, min(worst + STRETCH_FRAMES, frame_count) - 1),
        inconsistent=_frames_of_stretches((mean_square > MAX_MEAN_SQUARE) | (sums > MAX_SUM), frame_count),
    )


def _by_frame(block: ResidualBlock, values: FloatArray, frame_count: int) -> FloatArray:
    """Sum (M, D) values by the frame of their measurement: (N, D)."""
    return np.stack([np.bincount(block.frame, column, minlength=frame_count) for column in values.T], axis=1)


def _sum_stretches(values: FloatArray) -> FloatArray:
    """Sum (N, D) values over all stretches, (N - L + 1, D) of length L, or over all where there are fewer."""
    length = min(STRETCH_FRAMES, len(values))
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    return np.asarray(total[length:] - total[:-length])


def _frames_of_stretches(chosen: BoolArray, frame_count: int) -> FrameRuns:
    """Return the frames that the chosen stretches cover, as runs."""
    covered = np.zeros(frame_count, dtype=bool)
    for begin in np.flatnonzero(chosen).tolist():
        covered[begin : begin + STRETCH_FRAMES] = True
    return frame_runs(covered)
