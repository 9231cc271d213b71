"""CSV tables and TUM trajectories: round trips, and errors that name file and line."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from asfm.datasets.tables import check_increasing, parse_integers, parse_numbers, read_csv, read_tum
from asfm.errors import AsfmError

IDENTITY = "0 0 0 0 0 0 1"


def write(folder: Path, text: str) -> Path:
    path = folder / "a.csv"
    path.write_text(text, encoding="utf-8", newline="")
    return path


# CSV


def test_columns_are_found_by_name_in_any_order(tmp_path: Path) -> None:
    path = write(tmp_path, "b,c,a\n1,2,3\n4,5,6\n")
    columns, rows = read_csv(path, ("a", "b"), ("c", "d"))
    assert columns == {"b": 0, "c": 1, "a": 2}
    assert rows == [(2, ["1", "2", "3"]), (3, ["4", "5", "6"])]


@pytest.mark.parametrize(
    "text",
    [
        "\ufeffa,b\n1,x y\n",  # byte-order mark
        "a,b\r\n1,x y\r\n",
        " a , b \n 1 , x y \n",
        'a,b\n1,"x y"\n',
        "a,b\n1,x y",
    ],
)
def test_spreadsheet_variants_read_alike(tmp_path: Path, text: str) -> None:
    columns, rows = read_csv(write(tmp_path, text), ("a", "b"))
    assert columns == {"a": 0, "b": 1} and rows == [(2, ["1", "x y"])]


def test_blank_lines_are_skipped_and_counted(tmp_path: Path) -> None:
    _, rows = read_csv(write(tmp_path, "\na\n\n1\n\n\n2\n"), ("a",))
    assert rows == [(4, ["1"]), (7, ["2"])]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"expected a header a,b\[,c\], found an empty file"),
        ("a\n1\n", r"line 1: expected the header a,b\[,c\], found a$"),
        ("a,b,d\n1,2,3\n", r"line 1: .*found a,b,d"),
        ("a,b,a\n1,2,3\n", r"line 1: .*found a,b,a"),
        ("\na,b,x\n", r"line 2: expected the header"),
        ("a,b\n", r"expected at least one row below the header, found none"),
        ("a,b\n1\n", r"line 2: expected 2 cells, found 1"),
        ("a,b\n1,2\n1,2,3\n", r"line 3: expected 2 cells, found 3"),
        ('a,b\n"1,2\n', r"cannot read the table"),
    ],
)
def test_a_fault_of_a_table_is_reported_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(AsfmError, match=rf"a\.csv(, |: ){message}") as error:
        read_csv(path, ("a", "b"), ("c",))
    assert "\n" not in str(error.value)


def test_only_a_table_that_may_be_empty_is_read_without_rows(tmp_path: Path) -> None:
    path = write(tmp_path, "b,a\n")
    assert read_csv(path, ("a", "b"), may_be_empty=True) == ({"b": 0, "a": 1}, [])
    with pytest.raises(AsfmError, match="found an empty file"):
        read_csv(write(tmp_path, ""), ("a", "b"), may_be_empty=True)


def test_a_file_that_is_missing_a_folder_or_not_utf8_is_reported(tmp_path: Path) -> None:
    with pytest.raises(AsfmError, match=r"none\.csv: expected a table, found none"):
        read_csv(tmp_path / "none.csv", ("a",))
    with pytest.raises(AsfmError, match="expected a table, found a folder"):
        read_csv(tmp_path, ("a",))
    (tmp_path / "a.csv").write_bytes(b"a\n\xff\n")
    with pytest.raises(AsfmError, match="in UTF-8, found the byte 0xff at 2"):
        read_csv(tmp_path / "a.csv", ("a",))


# Cells


@given(st.lists(st.floats(-1e30, 1e30), min_size=1))
def test_the_repr_of_a_number_is_read_as_the_same_number(values: list[float]) -> None:
    rows = [(line, ["x", repr(value)]) for line, value in enumerate(values, start=2)]
    found = parse_numbers(Path("a.csv"), rows, 1, "z_m")
    assert found.dtype == np.float64 and found.tolist() == values


@pytest.mark.parametrize("cell", ["nan", "inf", "-inf", "1e999"])
def test_a_number_that_is_not_finite_is_reported(cell: str) -> None:
    with pytest.raises(AsfmError, match=rf"a\.csv, line 9: expected a finite z_m, found {cell}"):
        parse_numbers(Path("a.csv"), [(8, ["1"]), (9, [cell])], 0, "z_m")


@pytest.mark.parametrize("cell", ["", "x", "1,5", "0x10", "1 2"])
def test_text_is_no_number(cell: str) -> None:
    with pytest.raises(AsfmError, match=rf"a\.csv, line 2: expected a number as z_m, found '{cell}'"):
        parse_numbers(Path("a.csv"), [(2, [cell])], 0, "z_m")


@given(st.lists(st.integers(-(2**63), 2**63 - 1), min_size=1))
def test_integers_of_64_bits_are_read_exactly(values: list[int]) -> None:
    found = parse_integers(Path("a.csv"), [(2, [str(value)]) for value in values], 0, "landmark")
    assert found.dtype == np.int64 and found.tolist() == values


@pytest.mark.parametrize("cell", ["1.5", "1e3", "", "x", str(2**63), str(-(2**63) - 1)])
def test_other_text_is_no_integer(cell: str) -> None:
    with pytest.raises(AsfmError, match=r"a\.csv, line 2: expected a whole number as landmark, found"):
        parse_integers(Path("a.csv"), [(2, [cell])], 0, "landmark")


def test_stamps_must_increase_strictly() -> None:
    rows = [(2, ["a"]), (4, ["b"]), (5, ["c"])]
    check_increasing(Path("a.csv"), rows, np.array([1.0, np.nextafter(1.0, 2.0), 2.0]))
    check_increasing(Path("a.csv"), rows[:1], np.array([1.0]))
    for stamps_s, found in (([1.0, 2.5, 2.5], "2.5"), ([1.0, 2.5, 2.0], "2.0")):
        message = rf"a\.csv, line 5: expected a timestamp_s after 2\.5 \(line 4\), found {found}"
        with pytest.raises(AsfmError, match=message):
            check_increasing(Path("a.csv"), rows, np.array(stamps_s))


# TUM


@given(seed=st.integers(0, 999), count=st.integers(1, 5))
@settings(max_examples=20, deadline=None)
def test_a_trajectory_has_the_written_stamps_positions_and_rotations(
    tmp_path_factory: pytest.TempPathFactory, seed: int, count: int
) -> None:
    rng = np.random.default_rng(seed)
    stamps_s = 1.7e9 + np.cumsum(rng.uniform(0.01, 1, count))
    positions_m, rotations = rng.normal(size=(count, 3)), Rotation.random(count, rng=rng)
    values = np.column_stack([stamps_s, positions_m, rotations.as_quat()])
    lines = [" ".join(repr(float(value)) for value in row) for row in values]
    found = read_tum(write(tmp_path_factory.mktemp("tum"), "\n".join(lines)))
    np.testing.assert_array_equal(found.timestamps_s, stamps_s)
    np.testing.assert_array_equal(found.world_from_vehicle[:, :3, 3], positions_m)
    np.testing.assert_allclose(found.world_from_vehicle[:, :3, :3], rotations.as_matrix(), atol=1e-12)
    np.testing.assert_array_equal(found.world_from_vehicle[:, 3], np.tile([0.0, 0, 0, 1], (count, 1)))


def test_comments_blank_lines_and_tabs_are_accepted(tmp_path: Path) -> None:
    text = f"# t x y z qx qy qz qw\n\n1 {IDENTITY} # first\n2\t{IDENTITY}\n"
    np.testing.assert_array_equal(read_tum(write(tmp_path, text)).timestamps_s, [1, 2])


def test_a_rounded_quaternion_is_normalised(tmp_path: Path) -> None:
    pose = read_tum(write(tmp_path, "0 1 2 3 0 0 0.71 0.71\n")).world_from_vehicle[0]
    np.testing.assert_allclose(pose[:3, :3], Rotation.from_euler("z", 90, degrees=True).as_matrix(), atol=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("# nothing\n", r"expected rows of timestamp_s x y z qx qy qz qw, found none"),
        (f"0 {IDENTITY} 1\n", r"line 1: expected 8 numbers .*found 9"),
        (f"# a\n0 {IDENTITY}\n1 0 0\n", r"line 3: expected 8 numbers .*found 3"),
        (f"0 {IDENTITY}\n1 0 0 x 0 0 0 1\n", r"line 2: expected a number as z, found 'x'"),
        (f"0 {IDENTITY}\n0 {IDENTITY}\n", r"line 2: expected a timestamp_s after 0\.0"),
        ("0 0 0 0 1 1 0 0\n", r"line 1: expected a unit quaternion qx qy qz qw, found length 1\.41421"),
    ],
)
def test_a_fault_of_a_trajectory_is_reported_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(AsfmError, match=rf"a\.csv(, |: ){message}") as error:
        read_tum(write(tmp_path, text))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("lost", ["nan nan nan nan nan nan nan", "0 0 0 0 0 0 0", "1 2 3 inf 0 0 1"])
def test_a_reference_may_hold_rows_without_a_pose(tmp_path: Path, lost: str) -> None:
    path = write(tmp_path, f"0 {IDENTITY}\n1 {lost}\n2 {IDENTITY}\n")
    found = read_tum(path, may_be_lost=True)
    assert np.isfinite(found.world_from_vehicle).all(axis=(1, 2)).tolist() == [True, False, True]
    np.testing.assert_array_equal(found.timestamps_s, [0, 1, 2])
    with pytest.raises(AsfmError, match="line 2"):
        read_tum(path)
