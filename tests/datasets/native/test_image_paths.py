"""Paths in a native folder: none that leads outside is read."""

from pathlib import Path

import pytest

from asfm.datasets import open_sequence
from asfm.datasets.native.image_paths import FILES, check_places, locate_images
from asfm.datasets.native.writer import write_native
from asfm.errors import AsfmError
from tests.datasets.sequences import make_sequence


def test_images_in_the_folder_are_located(tmp_path: Path) -> None:
    (tmp_path / "a" / "b").mkdir(parents=True)
    rows = [(2, ["0", "a/x.png"]), (3, ["1", ""]), (4, ["2", "a/b/../y.png"])]
    assert locate_images(tmp_path / "frames.csv", rows, 1) == [
        tmp_path / "a/x.png",
        None,
        tmp_path / "a/b/../y.png",
    ]


@pytest.mark.parametrize(
    "name", ["../secret.png", "/etc/hosts", "link.png", "frames/out/0.png", "frames/../../x.png", "x" * 300]
)
@pytest.mark.parametrize("column", ["image", "invalid_mask"])
def test_an_image_outside_is_refused(tmp_path: Path, name: str, column: str) -> None:
    write_native(tmp_path / "in", make_sequence())
    (tmp_path / "secret.png").write_bytes((tmp_path / "in" / "frames" / "000000.png").read_bytes())
    (tmp_path / "in" / "link.png").symlink_to(tmp_path / "secret.png")
    (tmp_path / "in" / "frames" / "out").symlink_to(tmp_path)
    cells = f"{name}," if column == "image" else f"frames/000000.png,{name}"
    (tmp_path / "in" / "frames.csv").write_text(f"timestamp_s,image,invalid_mask\n0,{cells}\n")
    with pytest.raises(AsfmError, match=r"frames\.csv, line 2: .*(?:leads outside|expected the path of an image)"):
        open_sequence(tmp_path / "in")


@pytest.mark.parametrize("name", FILES)
def test_a_sensor_file_outside_is_refused(tmp_path: Path, name: str) -> None:
    write_native(tmp_path / "in", make_sequence())
    check_places(tmp_path / "in")
    source = tmp_path / "in" / name
    if source.exists():
        source.rename(tmp_path / name)
    else:
        (tmp_path / name).touch()
    source.symlink_to(tmp_path / name)
    with pytest.raises(AsfmError, match=rf"{name}: expected a file in the folder .* leads outside"):
        open_sequence(tmp_path / "in")
