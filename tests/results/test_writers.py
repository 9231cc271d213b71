"""Writing results: independent readers read them back."""

import json
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from asfm.errors import AsfmError
from asfm.geometry.poses import make_pose, tum_from_pose
from asfm.results.tracks_csv import read_tracks
from asfm.results.writers import write_points, write_pose_sigmas, write_report, write_tracks, write_trajectory
from asfm.types import BoolArray, Landmarks, Tracks, Trajectory


def _trajectory(count: int, start_s: float = 0.0, seed: int = 0) -> Trajectory:
    rng = np.random.default_rng(seed)
    stamps = start_s + np.cumsum(rng.uniform(1e-3, 1.0, count))
    return Trajectory(stamps, make_pose(rng.normal(0, 100, (count, 3)), Rotation.random(count, rng)))


def _landmarks(count: int, seed: int = 0) -> Landmarks:
    rng = np.random.default_rng(seed)
    return Landmarks(
        track=np.arange(count),
        xyz_m=np.array([4e6, 5e5, -20]) + rng.normal(0, 50, (count, 3)),
        covariance_m2=np.tile(np.eye(3), (count, 1, 1)),
        sigma_m=rng.uniform(0.01, 2, count),
        views=rng.integers(2, 100_000, count),
        well_constrained=rng.random(count) < 0.5,
        arc_m=rng.normal(size=(count, 5, 3)),
    )


@given(count=st.integers(1, 20), start_s=st.sampled_from([0.0, 1.7e9]), seed=st.integers(0, 99))
@settings(max_examples=20, deadline=None)
def test_trajectory_read_by_numpy(
    count: int, start_s: float, seed: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    trajectory = _trajectory(count, start_s, seed)
    path = tmp_path_factory.mktemp("tum") / "trajectory.tum"
    write_trajectory(path, trajectory)
    rows = np.loadtxt(path, ndmin=2)
    np.testing.assert_array_equal(rows[:, 0], trajectory.timestamps_s)
    np.testing.assert_allclose(rows[:, 1:], tum_from_pose(trajectory.world_from_vehicle), atol=6e-10)


def test_trajectory_read_by_evo(tmp_path: Path) -> None:
    file_interface = pytest.importorskip("evo.tools.file_interface")
    trajectory = _trajectory(30, 1.7e9)
    write_trajectory(tmp_path / "trajectory.tum", trajectory)
    read = file_interface.read_tum_trajectory_file(str(tmp_path / "trajectory.tum"))
    assert read.check()[0]
    np.testing.assert_array_equal(read.timestamps, trajectory.timestamps_s)
    np.testing.assert_allclose(np.stack(read.poses_se3), trajectory.world_from_vehicle, atol=1e-8)


def test_trajectory_text_is_tidy(tmp_path: Path) -> None:
    path = tmp_path / "trajectory.tum"
    pose = make_pose(np.array([[-1e-12, 2.0, 3.0]]), Rotation.identity(1))
    write_trajectory(path, Trajectory(np.array([0.2]), pose))
    assert path.read_text() == (
        "# timestamp x y z qx qy qz qw\n"
        "0.2 0.000000000 2.000000000 3.000000000 0.000000000 0.000000000 0.000000000 1.000000000\n"
    )


def test_trajectory_with_nan_is_a_defect(tmp_path: Path) -> None:
    trajectory = _trajectory(3)
    trajectory.world_from_vehicle[1, 0, 3] = np.nan
    with pytest.raises(ValueError, match="row 1"):
        write_trajectory(tmp_path / "trajectory.tum", trajectory)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("count", [0, 1, 50])
def test_points_read_by_trimesh(tmp_path: Path, count: int) -> None:
    ply = pytest.importorskip("trimesh.exchange.ply")
    landmarks = _landmarks(count)
    path = tmp_path / "points.ply"
    write_points(path, landmarks)
    if not count:
        assert b"element vertex 0\n" in path.read_bytes() and path.read_bytes().endswith(b"end_header\n")
        return
    read = ply.load_ply(BytesIO(path.read_bytes()))
    vertices = read["metadata"]["_ply_raw"]["vertex"]["data"]
    xyz_m = np.column_stack([vertices[axis] for axis in "xyz"])
    np.testing.assert_array_equal(xyz_m, landmarks.xyz_m)
    np.testing.assert_array_equal(np.ravel(vertices["sigma_m"]), landmarks.sigma_m.astype(np.float32))
    np.testing.assert_array_equal(np.ravel(vertices["views"]), landmarks.views)
    np.testing.assert_array_equal(np.ravel(vertices["well_constrained"]), landmarks.well_constrained)


def _tracks(count: int, stated: bool = True, seed: int = 0) -> tuple[Tracks, BoolArray]:
    """Tracks of 2 to 5 observations in 9 frames, with numbers that no rounded text holds."""
    rng = np.random.default_rng(seed)
    frames = [np.sort(rng.choice(9, rng.integers(2, 6), replace=False)) for _ in range(count)]
    track = np.repeat(np.arange(count), [len(frame) for frame in frames])
    total = len(track)
    sigma = rng.uniform(1e-9, 0.1, (total, 2)) if stated else None
    frame = np.concatenate([np.zeros(0, int), *frames])
    return Tracks(track, frame, rng.uniform(0.1, 99, total), rng.normal(0, 0.3, total), sigma), rng.random(total) < 0.7


@pytest.mark.parametrize(("count", "stated"), [(0, False), (1, True), (40, True), (40, False)])
def test_tracks_come_back_bit_by_bit(tmp_path: Path, count: int, stated: bool) -> None:
    tracks, observed = _tracks(count, stated)
    write_tracks(tmp_path / "tracks.csv", tracks, observed)
    read, used = read_tracks(tmp_path / "tracks.csv", 9)
    for name in ("track", "frame", "range_m", "bearing_rad"):
        np.testing.assert_array_equal(getattr(read, name), getattr(tracks, name))
    np.testing.assert_array_equal(used, observed)
    assert (read.sigma is None) == (tracks.sigma is None or not count)
    if read.sigma is not None and tracks.sigma is not None:
        np.testing.assert_array_equal(read.sigma, tracks.sigma)
    write_tracks(tmp_path / "again.csv", read, used)
    assert (tmp_path / "again.csv").read_bytes() == (tmp_path / "tracks.csv").read_bytes()


def test_tracks_with_nan_are_a_defect(tmp_path: Path) -> None:
    tracks, observed = _tracks(3)
    tracks.bearing_rad[4] = np.nan
    with pytest.raises(ValueError, match="row 4"):
        write_tracks(tmp_path / "tracks.csv", tracks, observed)
    assert not list(tmp_path.iterdir())


HEADER = "track,frame,range_m,bearing_rad,sigma_range_m,sigma_bearing_rad,used"


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (["0,1,2.0,0.1,,,1", "0,1,2.0,0.1,,,1"], "line 3: expected a later frame of the same track.*found track 0, f"),
        (["1,1,2.0,0.1,,,1"], "line 2: .*after the header, found track 1"),
        (["0,1,2.0,0.1,,,1", "2,1,2.0,0.1,,,1"], "line 3: .*found track 2, frame 1"),
        (["0,9,2.0,0.1,,,1"], r"line 2: expected a frame in 0\.\.8, found 9"),
        (["0,1,2.0,0.1,,,2"], "line 2: expected 0 or 1 as used, found 2"),
        (["0,1,-2.0,0.1,,,1"], "line 2: expected a range_m above 0, found -2.0"),
        (["0,1,nan,0.1,,,1"], "line 2: expected a finite range_m, found nan"),
        (["0,1,2.0,7,,,1"], "line 2: expected a bearing_rad in"),
        (["0,1,2.0,0.1,0.01,,1"], "line 2: expected a number as sigma_bearing_rad, found ''"),
        (["0,1,2.0,0.1,0.01,0.02,1", "0,2,2.0,0.1,,,1"], "line 3: expected a number as sigma_range_m, found ''"),
        (["0,1,2.0,0.1,0.01,0,1"], "line 2: expected a sigma_bearing_rad above 0"),
        (["0.5,1,2.0,0.1,,,1"], "line 2: expected a whole number as track, found '0.5'"),
        (["0,9999999999999999999999,2.0,0.1,,,1"], "line 2: expected a whole number as frame"),
        (["0,1,2.0,0.1"], "line 2: expected 7 cells, found 4"),
    ],
)
def test_bad_tracks_are_one_line_with_file_and_row(tmp_path: Path, rows: list[str], said: str) -> None:
    (tmp_path / "tracks.csv").write_text("\n".join([HEADER, *rows]))
    with pytest.raises(AsfmError, match=rf"^[^\n]*tracks\.csv, {said}[^\n]*$"):
        read_tracks(tmp_path / "tracks.csv", 9)


def test_no_tracks_file_and_another_table_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(AsfmError, match=r"^[^\n]*tracks\.csv: expected a file, found none$"):
        read_tracks(tmp_path / "tracks.csv", 9)
    (tmp_path / "tracks.csv").write_text("timestamp_s,image\n")
    with pytest.raises(AsfmError, match=rf"^[^\n]*line 1: expected the header {HEADER}, found timestamp_s,image$"):
        read_tracks(tmp_path / "tracks.csv", 9)


def test_report_is_strict_sorted_json(tmp_path: Path) -> None:
    path = tmp_path / "report.json"
    report = {"b": np.float64(0.5), "a": {"n": np.int64(3), "l": np.arange(2), "p": Path("x"), "t": (True, None, "ö")}}
    write_report(path, report)
    text = path.read_text(encoding="utf-8")
    assert text.index('"a"') < text.index('"b"') and "ö" in text and text.endswith("}\n")
    assert json.loads(text) == {"b": 0.5, "a": {"n": 3, "l": [0, 1], "p": "x", "t": [True, None, "ö"]}}


@pytest.mark.parametrize("bad", [float("nan"), np.float32("inf"), np.array([0.0, np.nan]), object()])
def test_report_names_the_key_of_a_bad_value(tmp_path: Path, bad: object) -> None:
    with pytest.raises(ValueError, match=r"report\.stages\[0\]\.seconds"):
        write_report(tmp_path / "report.json", {"stages": [{"seconds": bad}]})
    assert not list(tmp_path.iterdir())


def test_unwritable_place_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(AsfmError, match=r"^[^\n]*none/report.json: cannot write: [^\n]*$"):
        write_report(tmp_path / "none" / "report.json", {})


def test_pose_sigmas_are_the_roots_of_the_diagonals(tmp_path: Path) -> None:
    sigma = np.random.default_rng(3).uniform(0.001, 0.1, (4, 6))
    covariance = sigma[:, :, None] * np.eye(6) * sigma[:, None] + 1e-9
    write_pose_sigmas(tmp_path / "pose_sigmas.csv", np.array([0.5, 1.0, 1.5, 2.25]), covariance)
    header, *rows = (tmp_path / "pose_sigmas.csv").read_text().splitlines()
    assert header == "timestamp_s,roll_rad,pitch_rad,yaw_rad,forward_m,port_m,up_m"
    read = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    np.testing.assert_array_equal(read[:, 0], [0.5, 1.0, 1.5, 2.25])
    np.testing.assert_allclose(read[:, 1:], sigma, rtol=1e-3)
    with pytest.raises(ValueError, match="pose sigmas"):
        write_pose_sigmas(tmp_path / "pose_sigmas.csv", np.arange(4.0), np.full((4, 6, 6), np.nan))
