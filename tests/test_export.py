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
from asfm.export import write_points, write_report, write_trajectory
from asfm.poses import make_pose, tum_from_pose
from asfm.types import Landmarks, Trajectory


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
