"""Writing results: independent readers read them back, and a folder appears whole or not at all."""

import json
import os
import signal
import subprocess
import sys
import time
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from asfm.errors import AsfmError
from asfm.export import results_folder, write_points, write_report, write_trajectory
from asfm.poses import make_pose, tum_from_pose
from asfm.types import Landmarks, Trajectory
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation


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
    (tmp_path / "file").write_text("")
    with pytest.raises(AsfmError, match="cannot make a folder"), results_folder(tmp_path / "file" / "out", False):
        pass


def _fill(folder: Path, text: str) -> None:
    (folder / "config.yaml").write_text(text)
    (folder / "report.json").write_text("{}")


def _snapshot(root: Path) -> dict[str, str]:
    return {str(file.relative_to(root)): file.read_text() for file in root.rglob("*") if file.is_file()}


def test_results_appear_only_when_whole(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "out"
    with results_folder(out, overwrite=False) as folder:
        assert folder.parent == out.parent and folder.name.endswith(".partial")
        _fill(folder, "new")
        assert not out.exists()
    assert _snapshot(tmp_path) == {"deep/out/config.yaml": "new", "deep/out/report.json": "{}"}
    ordinary = tmp_path / "ordinary"
    ordinary.mkdir()
    assert out.stat().st_mode == ordinary.stat().st_mode


@pytest.mark.parametrize("fault", [RuntimeError, KeyboardInterrupt, SystemExit, AsfmError])
@pytest.mark.parametrize("existing", [False, True])
def test_a_fault_in_the_middle_leaves_all_as_it_was(tmp_path: Path, fault: type[BaseException], existing: bool) -> None:
    out = tmp_path / "out"
    if existing:
        out.mkdir()
        _fill(out, "old")
    before = _snapshot(tmp_path)
    with pytest.raises(fault), results_folder(out, overwrite=True) as folder:
        _fill(folder, "half")
        raise fault
    assert _snapshot(tmp_path) == before
    assert [path.name for path in tmp_path.iterdir()] == (["out"] if existing else [])


def test_overwriting_replaces_and_leaves_nothing_behind(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    _fill(out, "old")
    (out / "points.ply").write_text("old")
    with pytest.raises(AsfmError, match="already holds results"), results_folder(out, overwrite=False):
        pass
    with results_folder(out, overwrite=True) as folder:
        _fill(folder, "new")
    assert _snapshot(tmp_path) == {"out/config.yaml": "new", "out/report.json": "{}"}
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_an_empty_folder_is_filled(tmp_path: Path) -> None:
    with results_folder(tmp_path / "out", overwrite=False) as folder:
        _fill(folder, "new")
    assert (tmp_path / "out" / "config.yaml").read_text() == "new"


@pytest.mark.parametrize("names", [["notes.txt"], ["report.json"], ["report.json", "config.yaml", "notes.txt"]])
def test_a_stranger_s_folder_is_refused(tmp_path: Path, names: list[str]) -> None:
    out = tmp_path / "out"
    out.mkdir()
    for name in names:
        (out / name).write_text("precious")
    before = _snapshot(tmp_path)
    with pytest.raises(AsfmError, match="choose another folder"), results_folder(out, overwrite=True):
        pytest.fail("the body must not run")
    assert _snapshot(tmp_path) == before


def test_a_file_and_the_working_directory_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("precious")
    with pytest.raises(AsfmError, match="found a file"), results_folder(tmp_path / "file", overwrite=True):
        pass
    monkeypatch.chdir(tmp_path)
    with pytest.raises(AsfmError, match="working directory"), results_folder(Path(), overwrite=True):
        pass


def test_a_stranger_that_arrives_during_the_run_survives_and_so_do_the_results(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(AsfmError, match="the results are whole in"), results_folder(out, overwrite=True) as folder:
        _fill(folder, "new")
        out.mkdir()
        (out / "notes.txt").write_text("precious")
    assert (out / "notes.txt").read_text() == "precious"
    assert (folder / "config.yaml").read_text() == "new"


def test_old_results_come_back_when_the_last_rename_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out"
    out.mkdir()
    _fill(out, "old")
    rename = Path.rename

    def refuse(self: Path, target: Path) -> Path:
        if self.suffix == ".partial":
            raise PermissionError(13, "no")
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", refuse)
    with pytest.raises(AsfmError, match="whole in"), results_folder(out, overwrite=True) as folder:
        _fill(folder, "new")
    assert (out / "config.yaml").read_text() == "old" and (folder / "config.yaml").read_text() == "new"


def test_a_link_to_a_folder_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "real")
    with results_folder(tmp_path / "link", overwrite=False) as folder:
        _fill(folder, "new")
    assert (tmp_path / "link").is_symlink() and (tmp_path / "real" / "config.yaml").read_text() == "new"


@pytest.mark.skipif(os.name != "posix", reason="sends POSIX signals")
@pytest.mark.parametrize(("sent", "left_behind"), [(signal.SIGINT, 0), (signal.SIGKILL, 1)])
def test_a_process_stopped_in_the_middle_leaves_no_results(
    tmp_path: Path, sent: signal.Signals, left_behind: int
) -> None:
    out = tmp_path / "out"
    code = (
        "import sys, time, pathlib; from asfm.export import results_folder\n"
        "with results_folder(pathlib.Path(sys.argv[1]), False) as folder:\n"
        "    (folder / 'report.json').write_text('{}'); time.sleep(60)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code, str(out)], stderr=subprocess.DEVNULL)
    try:
        deadline = time.monotonic() + 30
        while not list(tmp_path.glob("*.partial/report.json")) and time.monotonic() < deadline:
            time.sleep(0.02)
        process.send_signal(sent)
        assert process.wait(timeout=30) != 0
    finally:
        process.kill()
    assert not out.exists()
    assert len(list(tmp_path.glob("out.*.partial"))) == left_behind == len(list(tmp_path.iterdir()))
