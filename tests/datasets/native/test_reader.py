"""Reader of the native folder: conventions, laziness, and one-line errors for every fault."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from asfm.commands.describe import describe_sequence
from asfm.commands.run import run_sequence
from asfm.datasets import open_sequence
from asfm.datasets.native.reader import open_native_truth, read_native
from asfm.datasets.native.writer import write_native
from asfm.errors import AsfmError
from asfm.geometry.poses import invert, transform
from asfm.geometry.sonar import SonarModel, back_project, project
from tests.datasets.sequences import EVEN, UNEVEN, assert_same, make_sequence


def mirror_on_disk(folder: Path, bearings: str) -> None:
    """Rewrite a folder with column 0 to port; the scene stays the same."""
    for path in [*(folder / "frames").iterdir(), *(folder / "invalid").iterdir()]:
        pixels = np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED))
        cv2.imwrite(str(path), pixels[:, ::-1])
    lines = (folder / "sequence.yaml").read_text().splitlines()
    kept = [f"  {bearings}" if line.strip().startswith("bearing") else line for line in lines]
    (folder / "sequence.yaml").write_text("\n".join(line for line in kept if not line.startswith("   ")) + "\n")


@pytest.mark.parametrize("sonar", [EVEN, UNEVEN], ids=["even", "uneven"])
def test_descending_bearings_give_the_same_sequence(tmp_path: Path, sonar: SonarModel) -> None:
    expected = make_sequence(sonar)
    write_native(tmp_path / "port_first", expected)
    edges_deg = np.degrees(sonar.bearing_edges_rad[[-1, 0]]).tolist()
    centres_deg = np.degrees(sonar.bearing_rad[::-1]).tolist()
    bearings = f"bearing_deg: {edges_deg}" if sonar is EVEN else f"bearings_deg: {centres_deg}"
    mirror_on_disk(tmp_path / "port_first", bearings)
    assert_same(read_native(tmp_path / "port_first"), expected)


def test_one_echo_to_port_is_at_positive_bearing(tmp_path: Path) -> None:
    """With bearing_deg [30, -30], the third column of eight lies to port, so its bearing is positive."""
    folder = tmp_path / "sequence"
    (folder / "frames").mkdir(parents=True)
    pixels = np.zeros((4, 8), np.uint8)
    pixels[1, 2] = 255
    cv2.imwrite(str(folder / "frames" / "a.png"), pixels)
    (folder / "frames.csv").write_text("timestamp_s,image\n0.5,frames/a.png\n")
    (folder / "sequence.yaml").write_text(
        "sonar: {range_m: [0, 2], bearing_deg: [30, -30], elevation_aperture_deg: 12}\n"
    )
    sequence = read_native(folder)
    row, column = np.argwhere(sequence.read_frame(0).image == 1.0)[0]
    assert sequence.sonar.range_m[row] == pytest.approx(0.75)
    assert np.degrees(sequence.sonar.bearing_rad[column]) == pytest.approx(30 - 2.5 * 7.5)


def test_opening_ten_thousand_rows_reads_no_image_but_the_first(tmp_path: Path) -> None:
    write_native(tmp_path / "long", make_sequence(count=1))
    folder, count = tmp_path / "long", 10_000
    stamps = 1.7e9 + 0.1 * np.arange(count)
    rows = [f"{stamp!r},frames/{'000000' if index == 0 else index}.png" for index, stamp in enumerate(stamps.tolist())]
    (folder / "frames.csv").write_text("timestamp_s,image\n" + "\n".join(rows))
    for name in ("odometry", "groundtruth"):
        (folder / f"{name}.tum").write_text("\n".join(f"{stamp!r} 1 2 3 0 0 0 1" for stamp in stamps.tolist()))
    rows = [f"{stamp!r},1,0.1,0.2" for stamp in stamps.tolist()]
    (folder / "navigation.csv").write_text("timestamp_s,z_m,roll_rad,pitch_rad\n" + "\n".join(rows))
    sequence = open_sequence(folder)
    assert len(sequence) == count
    with pytest.raises(AsfmError, match=r"9999\.png.*found none"):
        sequence.read_frame(9_999)


@pytest.mark.parametrize(("name", "count"), [("oculus_tank_a", 87), ("oculus_tank_b", 121)])
def test_hand_tracks_lie_on_echoes_but_not_when_mirrored(shared_data: Path, name: str, count: int) -> None:
    """Check the bearing convention independently: hand-tracked (range, bearing) against the pixels."""
    sequence = open_sequence(shared_data / name)
    assert len(sequence) == count and sequence.hand_tracks is not None
    tracks, sonar = sequence.hand_tracks, sequence.sonar
    at_track: list[float] = []
    at_mirror: list[float] = []
    for index in range(0, count, 10):
        frame = sequence.read_frame(index)
        here = np.isclose(tracks.timestamps_s, frame.timestamp_s)
        rows = sonar.row_at_range(tracks.range_m[here]).astype(int)
        for sign, levels in ((1.0, at_track), (-1.0, at_mirror)):
            columns = sonar.column_at_bearing(sign * tracks.bearing_rad[here]).astype(int)
            levels += [frame.image[r - 4 : r + 5, c - 4 : c + 5].max() for r, c in zip(rows, columns, strict=True)]
    assert np.median(at_track) > 2 * np.median(at_mirror)


def test_the_simulated_recording_has_all_its_sensors(shared_data: Path) -> None:
    sequence = open_sequence(shared_data / "simulated_seafloor")
    assert sequence.sonar.shape == (600, 256) and len(sequence) == 80 and sequence.diagnostics == ()
    assert sequence.odometry is not None and sequence.navigation is not None and sequence.groundtruth is not None
    assert sequence.noise.odometry_rotation_rad == pytest.approx(np.radians(0.3))
    read = open_native_truth(shared_data / "simulated_seafloor")
    assert read is not None
    noisy, truth = sequence.read_frame(3).image, read(3)
    assert np.corrcoef(noisy.ravel(), truth.clean.ravel())[0, 1] > 0.5
    assert np.corrcoef(noisy[:, ::-1].ravel(), truth.clean.ravel())[0, 1] < 0.5, "image and truth are flipped alike"


def test_elevation_poses_and_bearings_of_the_simulated_recording_agree(shared_data: Path) -> None:
    """Points at their true elevations, moved by the true poses, have the true elevations of the later frame."""
    folder = shared_data / "simulated_seafloor"
    sequence, read = open_sequence(folder), open_native_truth(folder)
    assert read is not None and sequence.groundtruth is not None
    sonar, poses = sequence.sonar, sequence.groundtruth.world_from_vehicle @ sequence.vehicle_from_sonar
    before, after = read(0).elevation_rad, read(20).elevation_rad
    rows, columns = np.nonzero(np.isfinite(before))

    def median_error_rad(side: int) -> float:
        xyz_m = back_project(sonar.range_m[rows], side * sonar.bearing_rad[columns], before[rows, columns])
        seen_m = transform(invert(poses[20]) @ poses[0], xyz_m)
        seen_m = seen_m[sonar.sees(seen_m)]
        range_m, bearing_rad, elevation_rad = project(seen_m)
        row, column = sonar.row_at_range(range_m).astype(int), sonar.column_at_bearing(side * bearing_rad).astype(int)
        return float(np.nanmedian(np.abs(after[row, column] - elevation_rad)))

    assert median_error_rad(1) < np.radians(0.2) < 2 * np.radians(0.2) < median_error_rad(-1)


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
    ("no frames.csv", remove("frames.csv"), r"frames\.csv: expected a table, found none"),
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
    (
        "yaml zero",
        edit("sequence.yaml", "elevation_aperture_deg: ", "elevation_aperture_deg: -"),
        r"equal to 0\.001",
    ),
    ("yaml broken", put("sequence.yaml", "sonar: [\n"), r"sequence\.yaml: cannot read the settings"),
    ("yaml date", put("sequence.yaml", "sonar: 2020-99-99\n"), r"sequence\.yaml: cannot read the settings"),
    ("yaml deep", put("sequence.yaml", "[" * 1500), r"sequence\.yaml: cannot read the settings"),
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
def test_an_invalid_text_file_is_reported_on_opening(
    tmp_path: Path, spoil: Callable[[Path], None], message: str
) -> None:
    write_native(tmp_path / "sequence", make_sequence())
    spoil(tmp_path / "sequence")
    with pytest.raises(AsfmError, match=message) as error:
        open_sequence(tmp_path / "sequence")
    assert "\n" not in str(error.value)


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
        (stuff_jpeg, r"found a JPEG image"),
        (Path.unlink, r"found none"),
    ],
)
def test_an_invalid_image_is_reported_when_its_frame_is_read(
    tmp_path: Path, kind: str, spoil: Callable[[Path], None], message: str
) -> None:
    write_native(tmp_path / "sequence", make_sequence())
    spoil(tmp_path / "sequence" / kind / "000002.png")
    sequence = read_native(tmp_path / "sequence")
    sequence.read_frame(1)
    with pytest.raises(AsfmError, match=rf"{kind}.000002\.png: {'.*'}{message}"):
        sequence.read_frame(2)


@pytest.mark.parametrize("kind", ["frames", "invalid"])
@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (colour, r"one channel\), found RGB"),
        (grow, r"expected 12 x 8 pixels .*found 13 x 8"),
        (stuff_jpeg, r"found a JPEG image"),
        (Path.unlink, r"found none"),
    ],
)
def test_the_headers_of_all_images_are_checked_without_decoding_them(
    tmp_path: Path, kind: str, spoil: Callable[[Path], None], message: str
) -> None:
    write_native(tmp_path / "sequence", make_sequence())
    corrupt(tmp_path / "sequence" / "frames" / "000001.png")
    read_native(tmp_path / "sequence").check_frames()
    spoil(tmp_path / "sequence" / kind / "000002.png")
    with pytest.raises(AsfmError, match=rf"{kind}.000002\.png: {'.*'}{message}"):
        read_native(tmp_path / "sequence").check_frames()
    with pytest.raises(AsfmError, match=rf"{kind}.000002\.png: {'.*'}{message}"):
        describe_sequence(tmp_path / "sequence")
    with pytest.raises(AsfmError, match=rf"{kind}.000002\.png: {'.*'}{message}"):
        run_sequence(tmp_path / "sequence", tmp_path / "results", recording=False)
    assert not (tmp_path / "results").exists()


def test_a_frame_that_does_not_exist_raises_index_error(tmp_path: Path) -> None:
    write_native(tmp_path / "sequence", make_sequence())
    sequence = read_native(tmp_path / "sequence")
    for index in (-1, 3):
        with pytest.raises(IndexError):
            sequence.read_frame(index)
