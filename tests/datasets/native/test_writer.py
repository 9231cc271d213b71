"""Writer of the native folder: round trips, overwriting, streaming, and refused sequences."""

import dataclasses
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from asfm.datasets.native.reader import read_native
from asfm.datasets.native.writer import write_native
from asfm.errors import AsfmError
from asfm.geometry.sonar import SonarModel
from asfm.types import Frame, FrameTruth
from tests.datasets.sequences import EVEN, UNEVEN, assert_same, make_sequence


@pytest.mark.parametrize("sonar", [EVEN, UNEVEN], ids=["even", "uneven"])
@pytest.mark.parametrize("bits", [8, 16])
def test_a_written_sequence_is_read_back_the_same(tmp_path: Path, sonar: SonarModel, bits: int) -> None:
    expected = make_sequence(sonar, bits=bits)
    write_native(tmp_path / "sequence", expected, bits=16 if bits == 16 else 8)
    assert_same(read_native(tmp_path / "sequence"), expected)


@given(
    near=st.floats(0, 50),
    length=st.floats(0.01, 100),
    first=st.floats(-1.5, 0.5),
    width=st.floats(0.01, 2),
    aperture=st.floats(0.01, 1),
    shape=st.tuples(st.integers(2, 6), st.integers(2, 6)),
    seed=st.integers(0, 99),
)
@settings(max_examples=15, deadline=None)
def test_any_pixel_grid_survives_the_round_trip(
    tmp_path_factory: pytest.TempPathFactory,
    near: float,
    length: float,
    first: float,
    width: float,
    aperture: float,
    shape: tuple[int, int],
    seed: int,
) -> None:
    sonar = SonarModel.evenly_spaced("any", (near, near + length), (first, first + width), shape, aperture)
    expected = make_sequence(sonar, count=1, seed=seed)
    folder = tmp_path_factory.mktemp("any") / "sequence"
    write_native(folder, expected)
    assert_same(read_native(folder), expected)


def test_one_frame_without_sensors_survives_the_round_trip(tmp_path: Path) -> None:
    full = make_sequence(count=1)
    bare = dataclasses.replace(full, odometry=None, navigation=None, groundtruth=None, hand_tracks=None)
    write_native(tmp_path / "one", bare)
    assert sorted(path.name for path in (tmp_path / "one").iterdir()) == ["frames", "frames.csv", "sequence.yaml"]
    assert_same(read_native(tmp_path / "one"), bare)


def test_a_folder_is_replaced_only_with_overwrite(tmp_path: Path) -> None:
    folder, sequence = tmp_path / "sequence", make_sequence()
    write_native(folder, sequence)
    with pytest.raises(AsfmError, match=r"already holds a sequence.*--overwrite"):
        write_native(folder, make_sequence(seed=1))
    assert_same(read_native(folder), sequence)
    write_native(folder, make_sequence(seed=1), overwrite=True)
    assert_same(read_native(folder), make_sequence(seed=1))
    assert [path.name for path in tmp_path.iterdir()] == ["sequence"]


def test_overwriting_refuses_a_folder_that_is_no_sequence(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(AsfmError, match=r"expected an empty place, found thesis\.tex"):
        write_native(tmp_path, make_sequence(), overwrite=True)
    assert (tmp_path / "thesis.tex").exists()


@pytest.mark.parametrize("name", ["README.md", "frames/best/000000.png", "raw/dive.aris"])
def test_overwriting_refuses_a_folder_with_other_files(tmp_path: Path, name: str) -> None:
    folder, sequence = tmp_path / "sequence", make_sequence()
    truth = FrameTruth(np.zeros(sequence.sonar.shape), np.zeros(sequence.sonar.shape, np.float32))
    for overwrite in (False, True):
        write_native(folder, sequence, lambda index: truth, overwrite)
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text("precious")
    with pytest.raises(AsfmError, match=r"which asfm did not write"):
        write_native(folder, make_sequence(), overwrite=True)
    assert (folder / name).read_text() == "precious"


def test_a_sequence_can_overwrite_the_folder_that_it_is_read_from(tmp_path: Path) -> None:
    write_native(tmp_path / "sequence", make_sequence())
    write_native(tmp_path / "sequence", read_native(tmp_path / "sequence"), overwrite=True)
    assert_same(read_native(tmp_path / "sequence"), make_sequence())


def test_an_empty_folder_and_missing_parents_are_accepted(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for folder in (tmp_path / "empty", tmp_path / "a" / "b"):
        write_native(folder, make_sequence())
        assert len(read_native(folder)) == 3


def test_a_file_at_the_path_is_reported(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(AsfmError, match=r"found a file"):
        write_native(tmp_path / "file", make_sequence(), overwrite=True)
    with pytest.raises(AsfmError, match=r"cannot make a folder"):
        write_native(tmp_path / "file" / "below", make_sequence())


@pytest.mark.parametrize("fault", [AsfmError("unreadable"), KeyboardInterrupt()])
def test_a_failure_while_writing_leaves_no_files(tmp_path: Path, fault: BaseException) -> None:
    sequence = make_sequence()

    def fail_late(index: int) -> Frame:
        if index == 2:
            raise fault
        return sequence.read_frame(index)

    with pytest.raises(type(fault)):
        write_native(tmp_path / "sequence", dataclasses.replace(sequence, read_frame=fail_late))
    assert list(tmp_path.iterdir()) == []


def test_frames_are_read_one_at_a_time_in_order(tmp_path: Path) -> None:
    sequence, calls = make_sequence(count=4), []

    def read(index: int) -> Frame:
        calls.append(f"read {index}")
        return sequence.read_frame(index)

    progress: list[tuple[int, int]] = []
    write_native(
        tmp_path / "sequence",
        dataclasses.replace(sequence, read_frame=read),
        progress=lambda done, total: progress.append((done, total)),
    )
    assert calls == [f"read {index}" for index in range(4)]
    assert progress == [(1, 4), (2, 4), (3, 4), (4, 4)]


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.zeros((12, 9), np.float32), r"frame 0: expected an image of shape \(12, 8\)"),
        (np.full((12, 8), 2.0, np.float32), r"frame 0: expected echo strengths in 0\.\.1, found 2\.0"),
        (np.full((12, 8), np.nan, np.float32), r"frame 0: expected echo strengths in 0\.\.1, found nan"),
    ],
)
def test_a_frame_that_cannot_be_written_is_refused(tmp_path: Path, image: np.ndarray, message: str) -> None:
    bad = Frame(0, 0.0, image, np.zeros(EVEN.shape, bool))
    with pytest.raises(AsfmError, match=message):
        write_native(tmp_path / "sequence", dataclasses.replace(make_sequence(), read_frame=lambda _: bad))


def test_uneven_ranges_are_refused(tmp_path: Path) -> None:
    sonar = dataclasses.replace(EVEN, range_m=EVEN.range_m**1.1)
    with pytest.raises(AsfmError, match=r"evenly spaced ranges"):
        write_native(tmp_path / "sequence", make_sequence(sonar))


def test_the_folder_has_default_permissions(tmp_path: Path) -> None:
    write_native(tmp_path / "sequence", make_sequence())
    (tmp_path / "plain").mkdir()
    assert (tmp_path / "sequence").stat().st_mode == (tmp_path / "plain").stat().st_mode
    assert os.access(tmp_path / "sequence" / "frames.csv", os.R_OK)
