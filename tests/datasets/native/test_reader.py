"""Faults of a native folder: each is one line that names the file, the row, what was expected and what was found."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from asfm.datasets import open_sequence
from asfm.datasets.native.reader import read_native
from asfm.datasets.native.writer import write_native
from asfm.errors import AsfmError
from asfm.geometry.sonar import SonarModel
from asfm.sequence import Sequence
from asfm.types import FloatArray, Frame, Navigation, Trajectory


def make_sequence(count: int = 3) -> Sequence:
    """A small sequence with masks, odometry and navigation."""
    sonar = SonarModel.evenly_spaced("sonar", (0.5, 3.0), (-0.5, 0.4), (12, 8), 0.2)
    image = np.linspace(0, 1, 96, dtype=np.float32).reshape(sonar.shape)
    stamps: FloatArray = np.arange(count, dtype=np.float64) + 1.7e9
    return Sequence(
        name="sequence",
        sonar=sonar,
        timestamps_s=stamps,
        read_frame=lambda index: Frame(index, float(stamps[index]), image, image > 0.9),
        odometry=Trajectory(stamps, np.broadcast_to(np.eye(4), (count, 4, 4))),
        navigation=Navigation(stamps, *np.zeros((3, count))),
    )


def edit(name: str, find: str, replace: str) -> Callable[[Path], None]:
    def apply(folder: Path) -> None:
        text = (folder / name).read_text()
        assert find in text
        (folder / name).write_text(text.replace(find, replace, 1))

    return apply


def put(name: str, text: str) -> Callable[[Path], None]:
    def apply(folder: Path) -> None:
        (folder / name).write_text(text)

    return apply


def remove(name: str) -> Callable[[Path], None]:
    return lambda folder: (folder / name).unlink()


CSV = "timestamp_s,image\n"
FAULTS: list[tuple[str, Callable[[Path], None], str]] = [
    ("no frames.csv", remove("frames.csv"), r"frames\.csv: expected a file, found none"),
    ("empty frames.csv", put("frames.csv", ""), r"frames\.csv: expected a header timestamp_s,image.*empty"),
    ("no rows", put("frames.csv", CSV), r"frames\.csv: expected at least one row"),
    ("header", put("frames.csv", "time,image\n0,a.png\n"), r"frames\.csv, line 1: .*found time,image"),
    ("short row", put("frames.csv", CSV + "0,a.png\n1\n"), r"frames\.csv, line 3: expected 2 cells, found 1"),
    ("no number", put("frames.csv", CSV + "zero,a.png\n"), r"frames\.csv, line 2: .*timestamp_s, found 'zero'"),
    ("nan stamp", put("frames.csv", CSV + "nan,a.png\n"), r"frames\.csv, line 2: expected a finite .*nan"),
    ("no name", put("frames.csv", CSV + "0,\n"), r"frames\.csv, line 2: expected the name of an image"),
    (
        "repeat",
        put("frames.csv", CSV + "1.5,a.png\n\n1.5,b.png\n"),
        r"frames\.csv, line 4: .*1\.5 \(line 2\), found 1\.5",
    ),
    ("back", put("frames.csv", CSV + "2.0,a.png\n1.0,b.png\n"), r"frames\.csv, line 3: .*after 2\.0 .*found 1\.0"),
    ("open quote", put("frames.csv", CSV + '0,"a.png\n'), r"frames\.csv: cannot read the table"),
    ("binary", put("frames.csv", "\x00\x01"), r"frames\.csv, line 1"),
    ("no image", put("frames.csv", CSV + "0,gone.png\n"), r"gone\.png: expected a grey PNG image, found none"),
    ("first no png", put("frames.csv", CSV + "0,frames.csv\n"), r"frames\.csv: expected a grey PNG image, found"),
    ("tum short", put("odometry.tum", "0 1 2 3 0 0 0\n"), r"odometry\.tum, line 1: expected 8 numbers .*found 7"),
    ("tum empty", put("odometry.tum", "# t x y z\n\n"), r"odometry\.tum: expected rows .*found none"),
    ("tum word", put("odometry.tum", "0 1 2 3 0 0 0 one\n"), r"odometry\.tum, line 1: .*qw, found 'one'"),
    ("tum nan", put("groundtruth.tum", "# c\n0 nan 2 3 0 0 0 1\n"), r"groundtruth\.tum, line 2: .*finite x, found nan"),
    ("tum inf", put("groundtruth.tum", "0 inf 2 3 0 0 0 1\n"), r"groundtruth\.tum, line 1: .*found inf"),
    ("tum zero quaternion", put("odometry.tum", "0 1 2 3 0 0 0 0\n"), r"line 1: expected a unit quaternion.*length 0"),
    ("tum repeat", put("odometry.tum", "0 1 2 3 0 0 0 1\n" * 2), r"odometry\.tum, line 2: .*after 0\.0"),
    ("other clock", put("odometry.tum", "0 1 2 3 0 0 0 1\n"), r"odometry\.tum: it covers .*no common time"),
    (
        "navigation",
        put("navigation.csv", "timestamp_s,z_m,roll_rad,pitch_rad\n0,0,0,x\n"),
        r"navigation\.csv, line 2: .*'x'",
    ),
    ("navigation order", edit("navigation.csv", "timestamp_s", "t"), r"navigation\.csv, line 1: expected the header"),
    (
        "landmark",
        put("landmarks.csv", "timestamp_s,landmark,range_m,bearing_rad\n0,a,1,0\n"),
        r"landmarks.*line 2.*'a'",
    ),
    ("yaml unknown", edit("sequence.yaml", "sonar:", "sonar2: 3\nsonar:"), r"sequence\.yaml: unknown key 'sonar2'"),
    ("yaml unknown inside", edit("sequence.yaml", "  name", "  colour: red\n  name"), r"unknown key 'sonar\.colour'"),
    (
        "yaml missing",
        edit("sequence.yaml", "  elevation_aperture_deg", "  #"),
        r"the key 'sonar\.elevation_aperture_deg'",
    ),
    (
        "yaml word",
        edit("sequence.yaml", "elevation_aperture_deg: ", "elevation_aperture_deg: a"),
        r"elevation_aperture_deg: ",
    ),
    ("yaml zero", edit("sequence.yaml", "elevation_aperture_deg: ", "elevation_aperture_deg: -"), r"greater than 0"),
    ("yaml broken", put("sequence.yaml", "sonar: [\n"), r"sequence\.yaml: cannot read the settings"),
    ("yaml date", put("sequence.yaml", "sonar: 2020-99-99\n"), r"sequence\.yaml: cannot read the settings"),
    ("yaml deep", put("sequence.yaml", "[" * 5000), r"sequence\.yaml: cannot read the settings"),
    ("yaml list", put("sequence.yaml", "- 1\n"), r"sequence\.yaml: the file: .*found \[1\]"),
    ("yaml empty", put("sequence.yaml", ""), r"sequence\.yaml: expected the key 'sonar'"),
    (
        "range order",
        edit("sequence.yaml", "range_m: [0.5, 3.0]", "range_m: [3.0, 0.5]"),
        r"sonar: expected range_m: \[near",
    ),
    ("range nan", edit("sequence.yaml", "range_m: [0.5,", "range_m: [.nan,"), r"sonar\.range_m\.0: .*finite"),
]


@pytest.mark.parametrize(("spoil", "message"), [fault[1:] for fault in FAULTS], ids=[fault[0] for fault in FAULTS])
def test_a_fault_in_the_text_is_named_at_opening(tmp_path: Path, spoil: Callable[[Path], None], message: str) -> None:
    write_native(tmp_path / "sequence", make_sequence())
    spoil(tmp_path / "sequence")
    with pytest.raises(AsfmError, match=message) as error:
        open_sequence(tmp_path / "sequence")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("bearings", "message"),
    [
        ("bearing_deg: [5, 5]", r"two different bearing_deg"),
        ("bearings_deg: [0, 1, 3, 2, 4, 5, 6, 7]", r"all increase or all decrease"),
        ("bearings_deg: [0, 1, 2]", r"expected 8 sonar\.bearings_deg.*found 3"),
        ("bearings_deg: [0, 1, 2, 3, 4, 5, 6, .inf]", r"bearings_deg\.7"),
        ("name: x", r"expected either bearing_deg"),
    ],
)
def test_bearings_that_make_no_sense_are_refused(tmp_path: Path, bearings: str, message: str) -> None:
    write_native(tmp_path / "sequence", make_sequence())
    text = f"sonar:\n  range_m: [0, 1]\n  elevation_aperture_deg: 12\n  {bearings}\n"
    (tmp_path / "sequence" / "sequence.yaml").write_text(text)
    with pytest.raises(AsfmError, match=message):
        read_native(tmp_path / "sequence")


def colour(path: Path) -> None:
    cv2.imwrite(str(path), np.zeros((12, 8, 3), np.uint8))


def grow(path: Path) -> None:
    cv2.imwrite(str(path), np.zeros((13, 8), np.uint8))


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-20])


def corrupt(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)


def stuff_jpeg(path: Path) -> None:
    path.write_bytes(b"\xff\xd8\xff\xe0" + b"0" * 100)


@pytest.mark.parametrize("kind", ["frames", "invalid"])
@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (colour, r"one channel\), found RGB"),
        (grow, r"expected 12 x 8 pixels .*found 13 x 8"),
        (cut, r"found one cut off after \d+ bytes"),
        (corrupt, r"found a wrong checksum"),
        (stuff_jpeg, r"found 33 bytes that are no PNG header"),
        (Path.unlink, r"found none"),
    ],
)
def test_a_bad_image_is_named_when_its_frame_is_read(
    tmp_path: Path, kind: str, spoil: Callable[[Path], None], message: str
) -> None:
    write_native(tmp_path / "sequence", make_sequence())
    spoil(tmp_path / "sequence" / kind / "000002.png")
    sequence = read_native(tmp_path / "sequence")
    sequence.read_frame(1)
    with pytest.raises(AsfmError, match=rf"{kind}.000002\.png: {'.*'}{message}"):
        sequence.read_frame(2)


def test_odometry_that_is_too_short_is_a_warning_with_numbers(tmp_path: Path) -> None:
    sequence = make_sequence(count=5)
    assert sequence.odometry is not None
    short = Trajectory(sequence.odometry.timestamps_s[:3], sequence.odometry.world_from_vehicle[:3])
    write_native(tmp_path / "sequence", dataclasses.replace(sequence, odometry=short))
    (diagnostic,) = read_native(tmp_path / "sequence").diagnostics
    assert diagnostic.code == "partial-sensor-coverage" and diagnostic.frames == ((3, 4),)
    assert "odometry.tum" in diagnostic.message and "2 of 5 frames" in diagnostic.message


def test_a_frame_that_does_not_exist_is_a_programmers_error(tmp_path: Path) -> None:
    write_native(tmp_path / "sequence", make_sequence())
    sequence = read_native(tmp_path / "sequence")
    for index in (-1, 3):
        with pytest.raises(IndexError):
            sequence.read_frame(index)
