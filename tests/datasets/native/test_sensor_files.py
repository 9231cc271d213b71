"""Sensor files of the native folder."""

import dataclasses
from pathlib import Path

from asfm.datasets.native.reader import read_native
from asfm.datasets.native.writer import write_native
from asfm.types import Trajectory
from tests.datasets.sequences import make_sequence


def test_odometry_that_is_too_short_is_a_warning_with_numbers(tmp_path: Path) -> None:
    sequence = make_sequence(count=5)
    assert sequence.odometry is not None
    short = Trajectory(sequence.odometry.timestamps_s[:3], sequence.odometry.world_from_vehicle[:3])
    write_native(tmp_path / "sequence", dataclasses.replace(sequence, odometry=short))
    (diagnostic,) = read_native(tmp_path / "sequence").diagnostics
    assert diagnostic.code == "partial-sensor-coverage" and diagnostic.frames == ((3, 4),)
    assert "odometry.tum" in diagnostic.message and "2 of 5 frames" in diagnostic.message
