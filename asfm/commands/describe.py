"""``asfm info``: what a sequence holds."""

from pathlib import Path

from asfm.datasets import open_sequence
from asfm.datasets.sequence_summary import Row, summarise_sequence


def describe_sequence(path: Path) -> list[Row]:
    """Describe a sequence of any format that is read as (name, value with unit) rows.

    Raises:
        AsfmError: the sequence or its first frame cannot be read.
    """
    return summarise_sequence(open_sequence(path))
