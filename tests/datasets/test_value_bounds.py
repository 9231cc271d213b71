"""Natural bounds of stamps and angles: what is in another unit is refused, with the unit in the message."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from asfm.datasets.native.sensor_files import read_hand_tracks, read_navigation
from asfm.datasets.tables import read_tum
from asfm.datasets.value_bounds import check_angles, check_stamps, median_step_s
from asfm.errors import AsfmError

WHERE = Path("a.csv")
UNITS = {"milliseconds": 1e3, "microseconds": 1e6, "nanoseconds": 1e9}


@given(
    start_s=st.sampled_from([0.0, 3600.0, 1.2e9, 1.7e9, 4e9, -100.0]),
    step_s=st.floats(1e-3, 3600),
    count=st.integers(1, 5),
)
def test_seconds_are_accepted(start_s: float, step_s: float, count: int) -> None:
    check_stamps(WHERE, start_s + step_s * np.arange(count, dtype=np.float64))


@pytest.mark.parametrize("name", UNITS)
@given(start_s=st.sampled_from([1.2e9, 1.7e9, 2e9]), step_s=st.floats(0.01, 5), count=st.integers(1, 5))
def test_times_since_1970_in_other_units_are_refused_by_name(
    name: str, start_s: float, step_s: float, count: int
) -> None:
    stamps = (start_s + step_s * np.arange(count, dtype=np.float64)) * UNITS[name]
    exponent = round(np.log10(UNITS[name]))
    with pytest.raises(AsfmError, match=rf"a\.csv, line 2: expected seconds .*like {name}: divide by 1e{exponent}$"):
        check_stamps(WHERE, stamps, list(range(2, 2 + count)))


@pytest.mark.parametrize(("name", "step_s"), [("nanoseconds", 0.2), ("nanoseconds", 0.03), ("microseconds", 0.1)])
def test_times_since_the_start_in_other_units_are_refused_by_name(name: str, step_s: float) -> None:
    stamps = UNITS[name] * step_s * np.arange(10, dtype=np.float64)
    with pytest.raises(AsfmError, match=rf"frame \d+: expected seconds as timestamp_s, found .*look like {name}"):
        check_stamps(WHERE, stamps)


def test_a_single_stamp_of_no_unit_is_refused_all_the_same() -> None:
    with pytest.raises(AsfmError, match=r"found 1e\+30: no clock counts so many seconds"):
        check_stamps(WHERE, np.array([1e30]))


def test_the_median_step_needs_two_stamps() -> None:
    assert np.isnan(median_step_s(np.array([4.0])))
    assert median_step_s(np.array([0.0, 1.0, 3.0, 10.0])) == 2


@given(st.lists(st.floats(-1.571, 1.571), min_size=1, max_size=5))
def test_angles_within_their_bound_are_accepted(angles_rad: list[float]) -> None:
    check_angles(WHERE, list(range(len(angles_rad))), np.array(angles_rad), "pitch_rad", np.pi / 2)


@given(st.floats(1.573, 360), st.sampled_from([-1, 1]))
def test_the_first_angle_beyond_is_named_with_its_line(angle: float, sign: int) -> None:
    with pytest.raises(AsfmError, match=r"a\.csv, line 3: expected \|pitch_rad\| <= 1\.571, found -?[0-9.]+ \(2 of 3"):
        check_angles(WHERE, [2, 3, 4], np.array([0.1, sign * angle, 10.0]), "pitch_rad", np.pi / 2)


def test_degrees_are_guessed_only_where_they_can_be() -> None:
    for angle, cause in ((30.0, r"degrees\?"), (3e4, "correct the values")):
        with pytest.raises(AsfmError, match=cause):
            check_angles(WHERE, [2], np.array([angle]), "roll_rad", 1.0)


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("1.7e12,1,0,0", r"line 3: expected seconds"),
        ("2,1,0,-1.6", r"line 3: expected \|pitch_rad\| <= 1\.571, found -1\.6"),
        ("2,1,7,0", r"line 3: expected \|roll_rad\| <= 6\.283, found 7"),
    ],
)
def test_navigation_beyond_its_bounds_is_refused_by_line(tmp_path: Path, row: str, message: str) -> None:
    path = tmp_path / "navigation.csv"
    path.write_text(f"timestamp_s,z_m,roll_rad,pitch_rad\n1,1,-6.28,1.57\n{row}\n")
    with pytest.raises(AsfmError, match=message):
        read_navigation(path)


def test_trajectories_and_hand_tracks_are_checked_too(tmp_path: Path) -> None:
    path = tmp_path / "odometry.tum"
    path.write_text("# EuRoC\n1700000000000000000 0 0 0 0 0 0 1\n1700000000200000000 0 0 0 0 0 0 1\n")
    with pytest.raises(AsfmError, match=r"odometry\.tum, line 2: expected seconds .*nanoseconds: divide by 1e9"):
        read_tum(path)
    path = tmp_path / "landmarks.csv"
    for row, message in (("1,2,3,20", r"line 2: expected \|bearing_rad\| <= 3\.142.*degrees"), ("1e12,2,3,0", "milli")):
        path.write_text(f"timestamp_s,landmark,range_m,bearing_rad\n{row}\n")
        with pytest.raises(AsfmError, match=message):
            read_hand_tracks(path)
