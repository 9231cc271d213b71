"""The native folder: what is written reads back, what is wrong is named."""

import dataclasses
import os
import time
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from asfm.datasets import open_sequence
from asfm.datasets.native.reader import open_native_truth, read_native
from asfm.datasets.native.writer import write_native
from asfm.errors import AsfmError
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import SonarModel, back_project, project
from asfm.sequence import Sequence
from asfm.types import Frame, FrameTruth, HandTracks, Navigation, SensorNoise, Trajectory

EVEN = SonarModel.evenly_spaced("even", (0.5, 3.0), (-0.5, 0.4), (12, 8), 0.2)
UNEVEN = SonarModel("uneven", EVEN.range_m, np.array([-0.5, -0.3, -0.2, -0.05, 0.0, 0.1, 0.3, 0.45]), 0.2)


def make_sequence(sonar: SonarModel = EVEN, count: int = 3, bits: int = 8, seed: int = 0) -> Sequence:
    """A sequence of noise with every sensor, whose pixels lie on the grid of the given bits."""
    rng = np.random.default_rng(seed)
    largest = 2**bits - 1
    images = (rng.integers(0, largest + 1, (count, *sonar.shape)) / np.float32(largest)).astype(np.float32)
    invalid = rng.random((count, *sonar.shape)) < 0.1
    invalid[0] = False
    stamps = np.cumsum(rng.uniform(0.1, 0.2, count)) + 1.7e9
    poses = make_pose(rng.normal(size=(count, 3)), Rotation.random(count, rng=rng))
    return Sequence(
        name="sequence",
        sonar=sonar,
        timestamps_s=stamps,
        read_frame=lambda index: Frame(index, float(stamps[index]), images[index], invalid[index]),
        vehicle_from_sonar=make_pose(np.array([0.1, -0.2, 0.3]), Rotation.from_euler("y", 0.3)),
        odometry=Trajectory(stamps, poses),
        navigation=Navigation(stamps, *rng.normal(size=(3, count))),
        groundtruth=Trajectory(stamps - 0.01, poses),
        noise=SensorNoise(0.01, 0.02, 0.03, 0.04, 0.05),
        hand_tracks=HandTracks(stamps, np.arange(count), rng.uniform(1, 2, count), rng.uniform(-0.1, 0.1, count)),
    )


def assert_same(found: Sequence, expected: Sequence) -> None:
    """Every field of two sequences agrees; text keeps numbers exactly, poses and bearings to rounding."""
    assert found.sonar.name == expected.sonar.name
    np.testing.assert_allclose(found.sonar.range_m, expected.sonar.range_m, atol=1e-9)
    np.testing.assert_allclose(found.sonar.bearing_rad, expected.sonar.bearing_rad, atol=1e-11)
    assert found.sonar.elevation_aperture_rad == pytest.approx(expected.sonar.elevation_aperture_rad)
    np.testing.assert_array_equal(found.timestamps_s, expected.timestamps_s)
    np.testing.assert_allclose(found.vehicle_from_sonar, expected.vehicle_from_sonar, atol=1e-12)
    for name in ("odometry", "groundtruth"):
        ours, theirs = getattr(found, name), getattr(expected, name)
        assert (ours is None) == (theirs is None)
        if ours is not None:
            np.testing.assert_array_equal(ours.timestamps_s, theirs.timestamps_s)
            np.testing.assert_allclose(ours.world_from_vehicle, theirs.world_from_vehicle, atol=1e-12)
    for name in ("navigation", "hand_tracks"):
        ours, theirs = getattr(found, name), getattr(expected, name)
        assert (ours is None) == (theirs is None)
        for field in dataclasses.fields(ours) if ours is not None else ():
            np.testing.assert_array_equal(getattr(ours, field.name), getattr(theirs, field.name))
    for field in dataclasses.fields(SensorNoise):
        assert getattr(found.noise, field.name) == pytest.approx(getattr(expected.noise, field.name), rel=1e-12)
    for ours, theirs in zip(found, expected, strict=True):
        assert (ours.index, ours.timestamp_s) == (theirs.index, theirs.timestamp_s)
        assert ours.image.dtype == np.float32
        np.testing.assert_array_equal(ours.image, theirs.image)
        np.testing.assert_array_equal(ours.invalid, theirs.invalid)


@pytest.mark.parametrize("sonar", [EVEN, UNEVEN], ids=["even", "uneven"])
@pytest.mark.parametrize("bits", [8, 16])
def test_write_then_read_gives_the_same_sequence(tmp_path: Path, sonar: SonarModel, bits: int) -> None:
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
def test_any_grid_survives_the_round_trip(
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


def test_a_bare_sequence_of_one_frame_survives(tmp_path: Path) -> None:
    full = make_sequence(count=1)
    bare = dataclasses.replace(full, odometry=None, navigation=None, groundtruth=None, hand_tracks=None)
    write_native(tmp_path / "one", bare)
    assert sorted(path.name for path in (tmp_path / "one").iterdir()) == ["frames", "frames.csv", "sequence.yaml"]
    assert_same(read_native(tmp_path / "one"), bare)


def test_truth_survives_and_is_deterministic(tmp_path: Path) -> None:
    sequence = make_sequence()
    elevation_rad = np.where(np.arange(96).reshape(12, 8) % 3 == 0, np.nan, np.linspace(-0.1, 0.1, 96).reshape(12, 8))

    def truth(index: int) -> FrameTruth:
        return FrameTruth(elevation_rad + 0.001 * index, sequence.read_frame(index).image)

    for name in ("a", "b"):
        write_native(tmp_path / name, sequence, truth=truth)
    read = open_native_truth(tmp_path / "a")
    assert read is not None
    for index in range(3):
        found = read(index)
        np.testing.assert_allclose(found.elevation_rad, truth(index).elevation_rad, atol=1e-7)
        np.testing.assert_array_equal(found.clean, truth(index).clean)
    files = sorted(path.relative_to(tmp_path / "a") for path in (tmp_path / "a").rglob("*") if path.is_file())
    assert all((tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes() for file in files)
    with zipfile.ZipFile(tmp_path / "a" / "truth" / "000000.npz") as archive:
        assert {entry.date_time[0] for entry in archive.infolist()} == {1980}, "no clock in the bytes"


def mirror_on_disk(folder: Path, bearings: str) -> None:
    """Store the same scene with column 0 to port."""
    for path in [*(folder / "frames").iterdir(), *(folder / "invalid").iterdir()]:
        pixels = np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED))
        cv2.imwrite(str(path), pixels[:, ::-1])
    lines = (folder / "sequence.yaml").read_text().splitlines()
    kept = [f"  {bearings}" if line.strip().startswith("bearing") else line for line in lines]
    (folder / "sequence.yaml").write_text("\n".join(line for line in kept if not line.startswith("   ")) + "\n")


@pytest.mark.parametrize("sonar", [EVEN, UNEVEN], ids=["even", "uneven"])
def test_descending_bearings_show_the_same_asymmetric_scene(tmp_path: Path, sonar: SonarModel) -> None:
    expected = make_sequence(sonar)
    write_native(tmp_path / "port_first", expected)
    edges_deg = np.degrees(sonar.bearing_edges_rad[[-1, 0]]).tolist()
    centres_deg = np.degrees(sonar.bearing_rad[::-1]).tolist()
    bearings = f"bearing_deg: {edges_deg}" if sonar is EVEN else f"bearings_deg: {centres_deg}"
    mirror_on_disk(tmp_path / "port_first", bearings)
    assert_same(read_native(tmp_path / "port_first"), expected)


def test_one_echo_to_port_is_at_positive_bearing(tmp_path: Path) -> None:
    """An echo placed by hand in a file with [30, -30] degrees: third column of eight is to port, i.e. positive."""
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
    start = time.perf_counter()
    sequence = open_sequence(folder)
    assert time.perf_counter() - start < 2.0, "some 0.15 s on one idle core"
    assert len(sequence) == count
    with pytest.raises(AsfmError, match=r"9999\.png.*found none"):
        sequence.read_frame(9_999)


# The writer minds its place.


def test_writing_replaces_nothing_unless_told_to(tmp_path: Path) -> None:
    folder, sequence = tmp_path / "sequence", make_sequence()
    write_native(folder, sequence)
    with pytest.raises(AsfmError, match=r"already holds a sequence.*--overwrite"):
        write_native(folder, make_sequence(seed=1))
    assert_same(read_native(folder), sequence)
    write_native(folder, make_sequence(seed=1), overwrite=True)
    assert_same(read_native(folder), make_sequence(seed=1))
    assert [path.name for path in tmp_path.iterdir()] == ["sequence"]


def test_overwriting_spares_a_folder_that_is_no_sequence(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(AsfmError, match=r"expected an empty place, found thesis\.tex"):
        write_native(tmp_path, make_sequence(), overwrite=True)
    assert (tmp_path / "thesis.tex").exists()


@pytest.mark.parametrize("name", ["README.md", "frames/best/000000.png", "raw/dive.aris"])
def test_overwriting_spares_what_somebody_put_into_a_sequence(tmp_path: Path, name: str) -> None:
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


def test_an_empty_folder_and_missing_parents_are_fine(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for folder in (tmp_path / "empty", tmp_path / "a" / "b"):
        write_native(folder, make_sequence())
        assert len(read_native(folder)) == 3


def test_a_file_in_the_way_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(AsfmError, match=r"found a file"):
        write_native(tmp_path / "file", make_sequence(), overwrite=True)
    with pytest.raises(AsfmError, match=r"cannot make a folder"):
        write_native(tmp_path / "file" / "below", make_sequence())


@pytest.mark.parametrize("fault", [AsfmError("unreadable"), KeyboardInterrupt()])
def test_a_failure_half_way_leaves_nothing_behind(tmp_path: Path, fault: BaseException) -> None:
    sequence = make_sequence()

    def fail_late(index: int) -> Frame:
        if index == 2:
            raise fault
        return sequence.read_frame(index)

    with pytest.raises(type(fault)):
        write_native(tmp_path / "sequence", dataclasses.replace(sequence, read_frame=fail_late))
    assert list(tmp_path.iterdir()) == []


def test_frames_stream_one_by_one(tmp_path: Path) -> None:
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


def test_the_folder_is_as_readable_as_any_other(tmp_path: Path) -> None:
    write_native(tmp_path / "sequence", make_sequence())
    (tmp_path / "plain").mkdir()
    assert (tmp_path / "sequence").stat().st_mode == (tmp_path / "plain").stat().st_mode
    assert os.access(tmp_path / "sequence" / "frames.csv", os.R_OK)


# Recordings.


@pytest.mark.parametrize(("name", "count"), [("oculus_tank_a", 87), ("oculus_tank_b", 121)])
def test_hand_tracks_lie_on_echoes_and_their_mirror_images_do_not(shared_data: Path, name: str, count: int) -> None:
    """The independent witness of the bearing convention: hand-tracked (range, bearing) against the pixels."""
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
    assert np.corrcoef(noisy[:, ::-1].ravel(), truth.clean.ravel())[0, 1] < 0.5, "both are turned alike"


def test_elevation_poses_and_bearings_of_the_simulated_recording_agree(shared_data: Path) -> None:
    """Points placed by true elevation, carried by true poses, show their true elevation; mirrored ones do not."""
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
