"""Sequence: frames are read one at a time, in order."""

from itertools import islice

import numpy as np

from asfm.geometry.sonar import SonarModel
from asfm.sequence import Sequence
from asfm.types import Frame

SONAR = SonarModel.evenly_spaced("made up", (1.0, 5.0), (-0.4, 0.4), (4, 3), 0.2)


def test_frames_are_read_in_order_and_only_when_needed() -> None:
    read: list[int] = []

    def read_frame(index: int) -> Frame:
        read.append(index)
        return Frame(index, 0.1 * index, np.zeros(SONAR.shape, np.float32), np.zeros(SONAR.shape, bool))

    sequence = Sequence("made up", SONAR, 0.1 * np.arange(5.0), read_frame)
    assert len(sequence) == 5 and read == []
    assert [frame.index for frame in islice(sequence, 2)] == [0, 1] and read == [0, 1]
    assert [frame.index for frame in sequence] == [0, 1, 2, 3, 4]
