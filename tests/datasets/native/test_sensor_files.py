"""Sensor files of the native folder: coverage of the frames, optional files and their columns."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from asfm.datasets.native.reader import read_native
from asfm.datasets.native.sensor_files import (
    check_coverage,
    read_hand_tracks,
    read_navigation,
    read_trajectory,
)
from asfm.datasets.native.writer import write_native
from asfm.errors import AsfmError
from asfm.types import Trajectory
from tests.datasets.sequences import make_sequence


def test_odometry_shorter_than_the_frames_gives_a_diagnostic(tmp_path: Path) -> None:
    sequence = make_sequence(count=5)
    assert sequence.odometry is not None
    short = Trajectory(sequence.odometry.timestamps_s[:3], sequence.odometry.world_from_vehicle[:3])
    write_native(tmp_path / "sequence", dataclasses.replace(sequence, odometry=short))
    (diagnostic,) = read_native(tmp_path / "sequence").diagnostics
    assert diagnostic.code == "partial-sensor-coverage" and diagnostic.frames == ((3, 4),)
    assert "odometry.tum" in diagnostic.message and "2 of 5 frames" in diagnostic.message


FRAMES_S = np.arange(5.0)


@pytest.mark.parametrize(
    ("sensor_s", "frames"),
    [
        ([-1, 9], None),
        ([0, 4], None),
        ([0.0009, 3.9991], None),  # stamps in text are rounded
        ([0.0011, 4], ((0, 0),)),
        ([0, 1, 2], ((3, 4),)),
        ([1, 3], ((0, 0), (4, 4))),
        ([2.2, 2.4], ((0, 4),)),  # overlaps in time, although no frame lies inside
    ],
)
def test_frames_outside_the_time_span_of_a_sensor_are_listed(
    sensor_s: list[float], frames: tuple[tuple[int, int], ...] | None
) -> None:
    found = check_coverage(Path("folder/odometry.tum"), np.array(sensor_s, dtype=float), FRAMES_S)
    assert [item.code for item in found] == ([] if frames is None else ["partial-sensor-coverage"])
    if frames is not None:
        count = sum(last - first + 1 for first, last in frames)
        assert found[0].frames == frames
        assert found[0].message.startswith("odometry.tum covers") and f"{count} of 5 frames" in found[0].message


@pytest.mark.parametrize("sensor_s", [[-2, -1], [5, 6], [1.7e9, 1.8e9]])
def test_time_spans_that_do_not_overlap_are_refused(sensor_s: list[float]) -> None:
    with pytest.raises(AsfmError, match=r"odometry\.tum: it covers .*no common time span"):
        check_coverage(Path("odometry.tum"), np.array(sensor_s, dtype=float), FRAMES_S)


def test_every_file_is_optional(tmp_path: Path) -> None:
    for read in (read_trajectory, read_navigation, read_hand_tracks):
        assert read(tmp_path / "none") is None


def test_columns_are_assigned_by_name(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("pitch_rad,z_m,timestamp_s,roll_rad\n0.4,0.2,0.1,0.3\n0.8,0.4,0.2,0.6\n")
    navigation = read_navigation(path)
    assert navigation is not None
    columns = navigation.timestamps_s, navigation.z_m, navigation.roll_rad, navigation.pitch_rad
    np.testing.assert_allclose(columns, np.outer([0.1, 0.2, 0.3, 0.4], [1, 2]))
    path.write_text("bearing_rad,landmark,range_m,timestamp_s\n0.4,2,3,1\n0.4,2,3,1\n")
    tracks = read_hand_tracks(path)
    assert tracks is not None
    found = tracks.timestamps_s, tracks.landmark, tracks.range_m, tracks.bearing_rad
    np.testing.assert_array_equal(found, np.outer([1, 2, 3, 0.4], [1, 1]))


def test_navigation_must_be_in_order_of_time(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("timestamp_s,z_m,roll_rad,pitch_rad\n1,0,0,0\n1,0,0,0\n")
    with pytest.raises(AsfmError, match=r"a\.csv, line 3: expected a timestamp_s after 1\.0"):
        read_navigation(tmp_path / "a.csv")
