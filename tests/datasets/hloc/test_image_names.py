"""Names of a sequence's images in the files of other programs."""

from pathlib import Path

import numpy as np
import pytest

from asfm.datasets.hloc.image_names import ImageNames, name_images
from asfm.datasets.native.reader import read_native
from asfm.datasets.native.writer import write_native
from tests.datasets.sequences import EVEN, make_sequence


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_native(tmp_path / "tank", make_sequence(count=5))
    return tmp_path / "tank"


def test_images_of_a_native_folder_have_the_names_of_frames_csv(folder: Path) -> None:
    names = name_images(folder, read_native(folder))
    assert names.names == tuple(f"frames/{frame:06d}.png" for frame in range(5))
    assert names.shape == EVEN.shape and not names.descending


def test_columns_from_port_to_starboard_are_descending(folder: Path) -> None:
    settings = (folder / "sequence.yaml").read_text().splitlines()
    turned = ["  bearing_deg: [20, -30]" if "bearing_deg" in line else line for line in settings]
    assert turned != settings
    (folder / "sequence.yaml").write_text("\n".join(turned))
    assert name_images(folder, read_native(folder)).descending


def test_images_that_are_no_files_have_six_digits(tmp_path: Path) -> None:
    names = name_images(tmp_path / "recording.aris", make_sequence(count=3))
    assert names == ImageNames(("000000", "000001", "000002"), EVEN.shape)


def test_a_frame_is_found_with_or_without_folder_and_suffix() -> None:
    found = ImageNames(("left/a.png", "left/b.c.png"), (4, 4)).find_frames()
    assert found == {
        **dict.fromkeys(("left/a.png", "a.png", "left/a", "a"), 0),
        **dict.fromkeys(("left/b.c.png", "b.c.png", "left/b.c", "b.c"), 1),
    }


def test_of_two_images_with_the_same_short_name_the_first_is_found() -> None:
    found = ImageNames(("left/a.png", "right/a.png"), (4, 4)).find_frames()
    assert found["a"] == found["a.png"] == found["left/a.png"] == 0
    assert found["right/a.png"] == found["right/a"] == 1


def test_frames_of_one_file_have_six_digits_too(folder: Path) -> None:
    rows = (folder / "frames.csv").read_text()
    (folder / "frames.csv").write_text(rows.replace("000003.png", "000001.png"))
    names = name_images(folder, read_native(folder)).names
    assert names == tuple(f"{frame:06d}" for frame in range(5))


def test_names_of_a_part_are_those_of_its_frames(folder: Path) -> None:
    names = name_images(folder, read_native(folder))
    assert names.take(np.array([1, 4])).names == ("frames/000001.png", "frames/000004.png")
    assert names.take(np.array([1, 4])).shape == names.shape
