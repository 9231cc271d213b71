"""Contents of a native folder: unused files, links that point nowhere, and numbers in image names."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from asfm.datasets.native.folder_contents import check_image_order, find_unused_files
from asfm.datasets.native.reader import read_native
from asfm.datasets.native.writer import write_native
from asfm.errors import AsfmError
from tests.datasets.sequences import make_sequence


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_native(tmp_path / "sequence", make_sequence())
    return tmp_path / "sequence"


def order(names: list[str]) -> list[str]:
    rows = [(line, [name]) for line, name in enumerate(names, start=2)]
    return [str(item) for item in check_image_order(Path("frames.csv"), rows, 0)]


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("odometry.csv", "odometry.tum"),
        ("odometry.txt", "odometry.tum"),
        ("Odometry.tum", "odometry.tum"),
        ("odometry.tum.txt", "odometry.tum"),
        ("odomtery.tum", "odometry.tum"),
        ("odom.csv", "odometry.tum"),
        ("dvl.csv", "odometry.tum"),
        ("navigation.tum", "navigation.csv"),
        ("imu.csv", "navigation.csv"),
        ("depth.txt", "navigation.csv"),
        ("ground_truth.tum", "groundtruth.tum"),
        ("groundtruth.csv", "groundtruth.tum"),
        ("landmark.csv", "landmarks.csv"),
        ("frames.txt", "frames.csv"),
    ],
)
def test_a_sensor_under_another_name_is_told(folder: Path, name: str, meant: str) -> None:
    (folder / meant).unlink()
    (folder / name).write_text("1 2 3")
    (found,) = find_unused_files(folder)
    assert (found.code, found.severity) == ("unused-file", "warning")
    assert found.message.startswith(f"{name} is not used: ") and f"read from {meant};" in found.message


def test_other_data_files_are_listed_in_one_note(folder: Path) -> None:
    for name in ("a.csv", "b.json", "c.npz", "d.mat", "e.yaml", "f.txt", "g.tum"):
        (folder / name).write_text("")
    (found,) = find_unused_files(folder)
    assert (found.code, found.severity) == ("unused-file", "info")
    assert found.message.endswith("a.csv, b.json, c.npz, d.mat, e.yaml and 2 more")


def test_what_is_read_and_notes_are_not_named(folder: Path) -> None:
    for name in (
        "README.md",
        "LICENSE",
        "readme.txt",
        "licence.txt",
        ".hidden.csv",
        "features.h5",
        "matches.h5",
        "x.mp4",
    ):
        (folder / name).write_text("")
    (folder / "results").mkdir()
    assert find_unused_files(folder) == [] == list(read_native(folder).diagnostics)


def test_opening_names_what_was_not_used(folder: Path) -> None:
    (folder / "odometry.tum").rename(folder / "odometry.csv")
    sequence = read_native(folder)
    assert sequence.odometry is None and [item.code for item in sequence.diagnostics] == ["unused-file"]


@pytest.mark.parametrize("name", ["odometry.tum", "navigation.csv", "groundtruth.tum", "landmarks.csv"])
def test_a_link_that_points_nowhere_is_refused(folder: Path, name: str) -> None:
    (folder / name).unlink()
    (folder / name).symlink_to("gone.tum")
    with pytest.raises(AsfmError, match=rf"{name}: expected a table, found a link to 'gone\.tum', which is missing"):
        read_native(folder)


@given(st.lists(st.integers(0, 10**20), min_size=1, max_size=8, unique=True), st.sampled_from(["{}.png", "a{}_l.png"]))
def test_numbers_that_rise_pass_with_and_without_padding(numbers: list[int], pattern: str) -> None:
    assert order([pattern.format(number) for number in sorted(numbers)]) == []
    assert order([pattern.format(f"{number:025d}") for number in sorted(numbers)]) == []


@given(st.permutations(range(12)))
def test_numbers_in_any_other_order_are_told(numbers: list[int]) -> None:
    assert bool(order([f"frames/{number}.png" for number in numbers])) == (list(numbers) != sorted(numbers))


def test_the_order_of_sorted_names_is_told_by_its_first_line() -> None:
    names = sorted(f"frames/{number}.png" for number in range(12))
    (found,) = order(names)
    assert "frames.csv, line 6: the image frames/2.png follows frames/11.png" in found and ", 1 times;" in found


def test_an_image_listed_twice_is_told() -> None:
    assert len(order(["0.png", "1.png", "1.png"])) == 1


@pytest.mark.parametrize(
    "names",
    [
        ["b.png", "a.png"],
        ["left9.png", "right8.png"],
        ["cam1_99.png", "cam2_1.png"],
        ["1700000000.25.png", "1700000000.5.png"],
        ["2023-09-20_171105_9.png", "2023-09-20_171106_1.png"],
    ],
)
def test_names_without_a_common_pattern_and_compound_numbers_pass(names: list[str]) -> None:
    assert order(names) == []


def test_opening_reports_the_order(folder: Path) -> None:
    lines = (folder / "frames.csv").read_text().splitlines()
    swapped = [line.replace("000001", "x").replace("000002", "000001").replace("x", "000002") for line in lines]
    (folder / "frames.csv").write_text("\n".join(swapped))
    (found,) = read_native(folder).diagnostics
    assert found.code == "images-out-of-order" and found.frames == ((2, 2),)
