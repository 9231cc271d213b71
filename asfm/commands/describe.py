"""Command ``asfm info``: describe a sequence."""

from pathlib import Path

from asfm.datasets import open_sequence
from asfm.datasets.sequence_summary import Row, summarise_sequence


def describe_sequence(path: Path) -> list[Row]:
    """Return (name, value with unit) rows that describe a sequence of any supported format.

    Raises:
        AsfmError: the sequence or its first frame cannot be read, or an image is of another kind or size.
    """
    sequence = open_sequence(path)
    sequence.check_frames()
    return summarise_sequence(sequence)
