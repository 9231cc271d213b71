"""Command ``asfm convert``: convert a sequence of any supported format to a native folder."""

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
    """Write a sequence, with its ground truth if it has any, as a native folder, frame by frame.

    Args:
        path: folder or file of the sequence, in any supported format.
        output: the native folder, which appears only when it is complete.
        overwrite: replace an existing sequence.
        progress: receives the number of frames written.
        bits: 8 or 16 per pixel; by default 8 where that is lossless, else 16.

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
        bits=bits or _choose_bits(sequence),
    )
    return sequence


def _choose_bits(sequence: Sequence) -> Bits:
    """Return 16 if the first, middle or last frame has values between the 256 levels of 8 bits, else 8."""
    for index in {0, len(sequence) // 2, len(sequence) - 1}:
        levels = sequence.read_frame(index).image.astype(np.float64) * 255
        if np.abs(levels - np.rint(levels)).max() > 1e-3:
            return 16
    return 8
