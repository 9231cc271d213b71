"""``asfm convert``: a sequence of any format that is read becomes a native folder."""

from pathlib import Path

import numpy as np

from asfm.datasets import open_sequence, open_truth
from asfm.datasets.images import Bits
from asfm.datasets.native.writer import write_native
from asfm.sequence import Sequence
from asfm.stages import Progress, no_progress


def convert_sequence(
    path: Path, output: Path, overwrite: bool = False, progress: Progress = no_progress, bits: Bits | None = None
) -> Sequence:
    """Write a sequence, with its truth if it has one, as a native folder, frame by frame.

    Args:
        path: folder or file of any format that is read.
        output: the folder, which appears only when it is whole.
        overwrite: replace a sequence that is there.
        progress: told how many frames are written.
        bits: 8 or 16 a pixel; by default 8 where that loses nothing, else 16.

    Raises:
        AsfmError: the sequence cannot be read or the folder cannot be written.
    """
    sequence = open_sequence(path)
    write_native(
        output,
        sequence,
        truth=open_truth(path),
        overwrite=overwrite,
        progress=lambda done, total: progress("convert", done, total),
        bits=bits or _find_bits(sequence),
    )
    return sequence


def _find_bits(sequence: Sequence) -> Bits:
    """Look at the first, the middle and the last frame for values between the 256 steps of 8 bits."""
    for index in {0, len(sequence) // 2, len(sequence) - 1}:
        steps = sequence.read_frame(index).image.astype(np.float64) * 255
        if np.abs(steps - np.rint(steps)).max() > 1e-3:
            return 16
    return 8
