"""Kinds of files: told by their first bytes in every message about an unexpected file."""

import io
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from asfm.datasets import open_sequence
from asfm.datasets.images import read_png_shape
from asfm.datasets.native.writer import write_native
from asfm.errors import AsfmError
from asfm.file_kinds import is_lfs_pointer, name_kind
from tests.datasets.holoocean_files import make_state, write_folder
from tests.datasets.sequences import make_sequence

POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n"


@pytest.mark.parametrize(
    ("suffix", "name"),
    [("jpg", "JPEG"), ("png", "PNG"), ("bmp", "BMP"), ("tiff", "TIFF"), ("pgm", "PGM"), ("webp", "WebP")],
)
def test_images_written_by_opencv_are_named(suffix: str, name: str) -> None:
    _, content = cv2.imencode(f".{suffix}", np.zeros((9, 9), np.uint8))
    assert f"a {name} image" in str(name_kind(bytes(content)[:64]))


def test_arrays_pointers_and_nothing_are_named() -> None:
    file = io.BytesIO()
    np.save(file, np.zeros(3))
    assert name_kind(file.getvalue()) == "a NumPy array"
    assert name_kind(b"") == "an empty file"
    assert name_kind(b"some text") is name_kind(b"RIFF1234WAVE") is None
    assert is_lfs_pointer(POINTER) and not is_lfs_pointer(b"version 1")


def test_a_recording_that_is_a_pointer_says_so(tmp_path: Path) -> None:
    path = tmp_path / "recording.aris"
    path.write_bytes(POINTER)
    with pytest.raises(AsfmError, match=r"recording\.aris: .*found a Git-LFS pointer .*git lfs pull"):
        open_sequence(path)


@pytest.mark.parametrize("name", ["sequence.yaml", "frames.csv", "odometry.tum", "navigation.csv", "frames/000000.png"])
def test_a_file_of_a_native_folder_that_is_a_pointer_says_so(tmp_path: Path, name: str) -> None:
    write_native(tmp_path / "a", make_sequence())
    (tmp_path / "a" / name).write_bytes(POINTER)
    with pytest.raises(AsfmError, match=rf"{name}: expected .*Git-LFS pointer .*git lfs pull"):
        open_sequence(tmp_path / "a")


def test_a_pickle_that_is_a_pointer_says_so(tmp_path: Path) -> None:
    root = write_folder(tmp_path / "a", [make_state(0), make_state(1)])
    assert json.loads((root / "Config.json").read_text())
    (root / "Data" / "1.pkl").write_bytes(POINTER)
    with pytest.raises(AsfmError, match=r"1\.pkl: expected a pickle, found a Git-LFS pointer"):
        open_sequence(root)


def test_a_jpeg_in_place_of_a_png_is_named(tmp_path: Path) -> None:
    _, content = cv2.imencode(".jpg", np.zeros((9, 9), np.uint8))
    (tmp_path / "0.jpg").write_bytes(bytes(content))
    with pytest.raises(AsfmError, match=r"0\.jpg: expected a grey PNG image, found .*a JPEG image: convert it"):
        read_png_shape(tmp_path / "0.jpg")
