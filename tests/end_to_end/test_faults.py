"""Bad input through the real command line: a one-line error and exit code 2, or a warning and finite poses."""

import dataclasses
import json
import os
import pickle
import signal
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from asfm.cli import run_command_line
from asfm.datasets.native.writer import write_native
from asfm.geometry.poses import invert, make_pose, tum_from_pose
from asfm.geometry.sonar import SonarModel, project
from asfm.sequence import Sequence
from asfm.types import FloatArray, Frame, ImageArray, Trajectory

SONAR = SonarModel.evenly_spaced("small", (1.0, 5.0), (-0.5, 0.5), (160, 96), 0.3)
RESULTS = {"trajectory.tum", "points.ply", "report.json", "config.yaml"}


def make_path(count: int) -> Trajectory:
    """A gentle sway, five frames a second."""
    stamps_s: FloatArray = np.arange(count) / 5.0
    phase = np.linspace(0, np.pi, count)
    xyz_m = np.stack([0.2 * np.sin(phase), 0.3 * (1 - np.cos(phase)), 0.1 * phase], axis=-1)
    return Trajectory(stamps_s, make_pose(xyz_m, Rotation.from_euler("zx", np.stack([0.1 * phase, 0.2 * phase], -1))))


def draw_blobs(world_from_sonar: FloatArray) -> ImageArray:
    """Sixty small echoes of a fixed scene over weak speckle."""
    rng = np.random.default_rng(7)
    scene_m = rng.uniform([1.5, -1.5, -0.4], [4.5, 1.5, 0.4], (60, 3))
    sizes = rng.uniform(1.0, 2.5, 60)
    sonar_from_world = invert(world_from_sonar)
    range_m, bearing_rad, _ = project(scene_m @ sonar_from_world[:3, :3].T + sonar_from_world[:3, 3])
    rows, columns = SONAR.row_at_range(range_m), SONAR.column_at_bearing(bearing_rad)
    row, column = np.mgrid[0.5 : SONAR.shape[0], 0.5 : SONAR.shape[1]]
    image = 0.05 * rng.rayleigh(size=SONAR.shape)
    for i, size in enumerate(sizes):
        image += 0.8 * np.exp(-((row - rows[i]) ** 2 + (column - columns[i]) ** 2) / (2 * size**2))
    return np.clip(image, 0, 1).astype(np.float32)


def make_sequence(count: int = 6, odometry: bool = True) -> Sequence:
    path = make_path(count)

    def read_frame(index: int) -> Frame:
        image = draw_blobs(path.world_from_vehicle[index])
        return Frame(index, float(path.timestamps_s[index]), image, np.zeros(image.shape, dtype=bool))

    return Sequence(
        "small",
        SONAR,
        path.timestamps_s,
        read_frame,
        odometry=path if odometry else None,
        groundtruth=path,
    )


def paint(sequence: Sequence, value: float, frames: range | None = None, invalid: bool = False) -> Sequence:
    """Give frames one value all over."""

    def read_frame(index: int) -> Frame:
        frame = sequence.read_frame(index)
        if frames is not None and index not in frames:
            return frame
        return dataclasses.replace(
            frame, image=np.full_like(frame.image, value), invalid=np.full(frame.image.shape, invalid)
        )

    return dataclasses.replace(sequence, read_frame=read_frame)


def read_results(folder: Path, count: int) -> tuple[FloatArray, dict[str, Any]]:
    """Check that a folder of results is whole and finite; gives the rows of the trajectory and the report."""
    assert {path.name for path in folder.iterdir()} >= RESULTS
    rows = np.loadtxt(folder / "trajectory.tum", ndmin=2)
    assert rows.shape == (count, 8) and np.isfinite(rows).all()
    header, _, body = (folder / "points.ply").read_bytes().partition(b"end_header\n")
    kind = np.dtype([("xyz", "<f8", 3), ("sigma_m", "<f4"), ("views", "<i4"), ("well_constrained", "u1")])
    points = np.frombuffer(body, kind)
    assert f"element vertex {len(points)}\n".encode() in header
    assert np.isfinite(points["xyz"]).all() and np.isfinite(points["sigma_m"]).all()
    text = (folder / "report.json").read_text()
    assert "NaN" not in text and "Infinity" not in text
    return rows, json.loads(text)


def run(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str]:
    """Run a command line; return the exit code and stderr without the progress."""
    capsys.readouterr()
    code = run_command_line([str(argument) for argument in arguments])
    lines = [line for line in capsys.readouterr().err.splitlines() if not line.endswith(" steps")]
    return code, "\n".join(lines)


def refuse(capsys: pytest.CaptureFixture[str], root: Path, path: Path, *options: str | Path) -> str:
    """Run a sequence that must be refused; return its one-line error."""
    before = sorted(root.rglob("*"))
    code, message = run(capsys, "run", path, "--output", root / "out", *options)
    assert code == 2, message
    assert message.startswith("asfm: ") and "\n" not in message and "Traceback" not in message
    assert sorted(root.rglob("*")) == before, "nothing is left behind"
    return message


def replace_line(path: Path, line: int, text: str) -> None:
    lines = path.read_text().splitlines()
    lines[line - 1] = text
    path.write_text("\n".join(lines) + "\n")


def resize_image(folder: Path) -> None:
    cv2.imwrite(str(folder / "frames" / "000003.png"), np.zeros((100, 96), np.uint8))


def truncate_image(folder: Path) -> None:
    path = folder / "frames" / "000005.png"
    path.write_bytes(path.read_bytes()[:-30])


def spoil_pose(name: str, word: str) -> Callable[[Path], None]:
    return lambda folder: replace_line(folder / name, 3, f"0.4 0 {word} 0 0 0 0 1")


SPOILED: dict[str, tuple[Callable[[Path], None], tuple[str, ...]]] = {
    "image of another size": (resize_image, ("000003.png", "expected 160 x 96 pixels", "found 100 x 96")),
    "image cut off": (truncate_image, ("000005.png", "cut off")),
    "image missing": (lambda folder: (folder / "frames" / "000002.png").unlink(), ("000002.png", "found none")),
    "nan in the odometry": (spoil_pose("odometry.tum", "nan"), ("odometry.tum, line 3", "finite y", "found nan")),
    "inf in the truth": (spoil_pose("groundtruth.tum", "-inf"), ("groundtruth.tum, line 3", "finite y", "found -inf")),
    "stamps that go back": (
        lambda folder: replace_line(folder / "frames.csv", 4, "0.1,frames/000002.png"),
        ("frames.csv, line 4", "expected a timestamp_s after 0.2 (line 3)", "found 0.1"),
    ),
    "nan stamp": (
        lambda folder: replace_line(folder / "frames.csv", 4, "nan,frames/000002.png"),
        ("frames.csv, line 4", "finite timestamp_s"),
    ),
    "no frames": (lambda folder: replace_line(folder / "frames.csv", 1, ""), ("frames.csv", "expected the header")),
    "no table of frames": (
        lambda folder: (folder / "frames.csv").unlink(),
        ("frames.csv", "expected a table, found none"),
    ),
    "settings": (
        lambda folder: replace_line(folder / "sequence.yaml", 1, "sonar: ["),
        ("sequence.yaml", "cannot read"),
    ),
}


@pytest.mark.parametrize(("spoil", "parts"), SPOILED.values(), ids=list(SPOILED))
def test_a_spoiled_sequence_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], spoil: Callable[[Path], None], parts: tuple[str, ...]
) -> None:
    write_native(tmp_path / "sequence", make_sequence())
    spoil(tmp_path / "sequence")
    message = refuse(capsys, tmp_path, tmp_path / "sequence")
    assert all(part in message for part in parts), message


def test_what_is_no_sequence_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "letter.txt").write_text("Dear sonar,")
    (tmp_path / "nothing.aris").write_bytes(b"")
    assert "none: expected a sequence, found none" in refuse(capsys, tmp_path, tmp_path / "none")
    for name in ("empty", "letter.txt", "nothing.aris"):
        message = refuse(capsys, tmp_path, tmp_path / name)
        assert f"{name}: expected one of the formats that are read" in message


def pack_aris(frames: int, samples: int = 20) -> bytes:
    """An ARIS recording of empty images, after the maker's layout."""
    content = bytearray(b"DDF\x05".ljust(1024, b"\0"))
    for index in range(frames):
        header = bytearray(1024)
        values = {4: ("<Q", 1_700_000_000_000_000 + 100_000 * index), 12: ("<4s", b"DDF\x05"), 436: ("<I", 9)}
        values |= {452: ("<I", 14), 464: ("<f", 1440.0), 468: ("<I", samples), 476: ("<I", 4593), 516: ("<I", 1)}
        for offset, (form, value) in values.items():
            struct.pack_into(form, header, offset, value)
        content += header + bytes(samples * 128)
    return bytes(content)


@pytest.mark.parametrize("missing", [1, 2000, 3000, 20 * 128 + 1024 + 5, 2 * (20 * 128 + 1024) + 10])
def test_a_truncated_aris_file_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str], missing: int) -> None:
    content = pack_aris(frames=3)
    (tmp_path / "whole.aris").write_bytes(content)
    (tmp_path / "dive.aris").write_bytes(content[:-missing])
    assert run_command_line(["info", str(tmp_path / "whole.aris")]) == 0
    message = refuse(capsys, tmp_path, tmp_path / "dive.aris")
    assert "dive.aris" in message and "cut off" in message


def write_pickles(folder: Path, pose: NDArray[Any]) -> Path:
    geometry = {"Azimuth": 60, "Elevation": 12, "RangeMin": 0.5, "RangeMax": 4.5, "RangeBins": 16, "AzimuthBins": 6}
    sonar = {"sensor_type": "ImagingSonar", "socket": "S", "Hz": 4, "configuration": geometry}
    sensors = [{"sensor_type": "PoseSensor", "socket": "S"}, sonar]
    (folder / "Data").mkdir(parents=True)
    (folder / "Config.json").write_text(json.dumps({"agents": [{"sensors": sensors}]}))
    for index in range(3):
        state = {"ImagingSonar": np.zeros((16, 6), np.float32), "PoseSensor": pose, "t": 0.25 * index}
        (folder / "Data" / f"{index}.pkl").write_bytes(pickle.dumps(state))
    return folder


class Intruder:
    """What a stranger's pickle may hold."""

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, ("intruded",)


def test_pickles_of_strangers_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    nan_pose = np.eye(4)
    nan_pose[0, 3] = np.nan
    message = refuse(capsys, tmp_path, write_pickles(tmp_path / "nan", nan_pose))
    assert "0.pkl" in message and "finite 4 x 4 pose" in message
    folder = write_pickles(tmp_path / "intruder", np.eye(4))
    (folder / "Data" / "1.pkl").write_bytes(pickle.dumps(Intruder()))
    assert "1.pkl" in refuse(capsys, tmp_path, folder)
    assert not (tmp_path / "intruded").exists()


@pytest.mark.parametrize(
    ("options", "parts"),
    [
        (["--set", "cfar.colour=red"], ["unknown key 'cfar.colour'", "known here"]),
        (["--set", "cfar"], ["--set cfar", "section.key=value"]),
        (["--set", "backend.rounds=0"], ["backend.rounds", "greater than or equal to 1"]),
        (["--mode", "wrong"], ["'mode'", "batch"]),
        (["--config", "none.yaml"], ["none.yaml", "found none"]),
        (["--colour"], ["--colour", "see asfm run --help"]),
        (["and", "another"], ["and", "see asfm run --help"]),
    ],
)
def test_a_faulty_command_line_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], parts: list[str]
) -> None:
    write_native(tmp_path / "sequence", make_sequence(count=1))
    message = refuse(capsys, tmp_path, tmp_path / "sequence", *options)
    assert all(part in message for part in parts), message


def test_other_people_s_places_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_native(tmp_path / "sequence", make_sequence(count=1))
    out = tmp_path / "out"
    out.write_text("a file")
    assert "found a file" in refuse(capsys, tmp_path, tmp_path / "sequence", "--overwrite")
    out.unlink()
    out.mkdir()
    (out / "thesis.tex").write_text("years of work")
    assert "thesis.tex" in refuse(capsys, tmp_path, tmp_path / "sequence", "--overwrite")
    for words in (["run", str(tmp_path / "sequence"), "--output"], ["convert", str(tmp_path / "sequence")]):
        code, message = run(capsys, *words, tmp_path / "sequence" / "sequence.yaml" / "below")
        assert code == 2 and "cannot make a folder" in message
    code, message = run(capsys, "run", tmp_path / "sequence", "--output", tmp_path / "sequence", "--overwrite")
    assert code == 2 and "expected an empty place" in message, "a sequence is not replaced by its own results"


# Poor data: the run ends with a warning, and its poses stay finite.


def run_poor(
    capsys: pytest.CaptureFixture[str], root: Path, sequence: Sequence, *options: str
) -> tuple[FloatArray, list[str]]:
    """Run a sequence that must end with a warning; give the rows of its trajectory and the codes of the warnings."""
    write_native(root / "sequence", sequence)
    code, message = run(capsys, "run", root / "sequence", "--output", root / "out", *options)
    assert code == 0 and "Traceback" not in message, message
    rows, report = read_results(root / "out", len(sequence))
    np.testing.assert_array_equal(rows[:, 0], sequence.timestamps_s)
    assert report["warnings"], "poor data without a warning"
    for found in report["warnings"]:
        assert found.keys() == {"code", "message", "frames", "severity"}
        assert f"warning: {found['message']} [{found['code']}]" in message
    return rows, [found["code"] for found in report["warnings"]]


@pytest.mark.parametrize("odometry", [False, True])
@pytest.mark.parametrize(("value", "invalid"), [(0.0, False), (1.0, False), (0.5, True)])
def test_frames_without_echoes_keep_their_poses(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], value: float, invalid: bool, odometry: bool
) -> None:
    sequence = paint(make_sequence(odometry=odometry), value, invalid=invalid)
    rows, _ = run_poor(capsys, tmp_path, sequence, "--no-rerun")
    held = make_path(6).world_from_vehicle if odometry else np.broadcast_to(np.eye(4), (6, 4, 4))
    np.testing.assert_allclose(rows[:, 1:], tum_from_pose(held), atol=1e-3)


def test_frames_with_echoes_make_landmarks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The sequence that the others spoil is a good one."""
    write_native(tmp_path / "sequence", make_sequence())
    code, message = run(capsys, "run", tmp_path / "sequence", "--output", tmp_path / "out")
    rows, report = read_results(tmp_path / "out", 6)
    assert code == 0 and report["counts"]["landmarks"] > 10, message
    np.testing.assert_allclose(rows[:, 1:4], make_path(6).world_from_vehicle[:, :3, 3], atol=0.1)


@pytest.mark.parametrize("odometry", [False, True])
def test_one_frame_is_a_run(tmp_path: Path, capsys: pytest.CaptureFixture[str], odometry: bool) -> None:
    rows, _ = run_poor(capsys, tmp_path, make_sequence(count=1, odometry=odometry))
    np.testing.assert_allclose(rows[0, 1:], [0, 0, 0, 0, 0, 0, 1], atol=1e-6)


@pytest.mark.parametrize("odometry", [False, True])
@pytest.mark.parametrize("frames", [range(0, 1), range(1, 5), range(5, 6)])
def test_frames_of_zeros_among_others_end_with_finite_poses(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], frames: range, odometry: bool
) -> None:
    run_poor(capsys, tmp_path, paint(make_sequence(odometry=odometry), 0.0, frames), "--no-rerun")


def test_two_frames_and_a_still_sonar_are_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_native(tmp_path / "two", make_sequence(count=2))
    first = make_sequence(odometry=False)
    still = dataclasses.replace(
        first,
        read_frame=lambda index: dataclasses.replace(
            first.read_frame(0), index=index, timestamp_s=float(first.timestamps_s[index])
        ),
        groundtruth=None,
    )
    write_native(tmp_path / "still", still)
    for name, count in (("two", 2), ("still", 6)):
        code, message = run(capsys, "run", tmp_path / name, "--output", tmp_path / "out", "--no-rerun", "--overwrite")
        assert code == 0, message
        rows, _ = read_results(tmp_path / "out", count)
    np.testing.assert_allclose(rows[:, 1:4], 0, atol=0.05)


# An interrupted run leaves no folder that could pass for a complete one.


@pytest.fixture
def long_sequence(tmp_path: Path) -> Path:
    """A folder whose run takes long enough to be stopped: one image under many names."""
    write_native(tmp_path / "sequence", make_sequence(count=1, odometry=False))
    rows = [f"{0.2 * index:.1f},frames/000000.png" for index in range(3000)]
    (tmp_path / "sequence" / "frames.csv").write_text("\n".join(["timestamp_s,image", *rows]) + "\n")
    (tmp_path / "sequence" / "groundtruth.tum").unlink()
    return tmp_path / "sequence"


@pytest.mark.skipif(os.name != "posix", reason="sends POSIX signals")
@pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGKILL, -9)])
def test_a_run_that_is_stopped_leaves_no_results(long_sequence: Path, sent: signal.Signals, code: int) -> None:
    root = long_sequence.parent
    command = [sys.executable, "-m", "asfm", "run", str(long_sequence), "--output", str(root / "out")]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        try:
            assert process.stderr.readline() == "front-end: 3000 steps\n"
            process.send_signal(sent)
            stderr = process.stderr.read()
            assert process.wait(timeout=60) == code
        finally:
            process.kill()
    assert "Traceback" not in stderr
    assert not (root / "out").exists()
    if sent != signal.SIGKILL:
        assert stderr == "asfm: interrupted; nothing half-written was left\n"
        assert [path.name for path in root.iterdir()] == ["sequence"]


@pytest.mark.parametrize(
    ("fault", "code", "expected"),
    [
        (OSError(28, "No space left on device"), 2, "asfm: {out}: cannot write: No space left on device"),
        (KeyboardInterrupt(), 130, "asfm: interrupted; nothing half-written was left"),
        (ZeroDivisionError("a bug"), 1, "this is a defect of asfm"),
    ],
)
def test_a_fault_in_the_middle_keeps_the_old_results(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    fault: BaseException,
    code: int,
    expected: str,
) -> None:
    write_native(tmp_path / "sequence", make_sequence(count=2))
    command = ["run", str(tmp_path / "sequence"), "--output", str(tmp_path / "out")]
    assert run(capsys, *command)[0] == 0
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}

    def fail(*arguments: object) -> None:
        raise fault

    monkeypatch.setattr("asfm.pipeline.reconstruction.summarise", fail)
    found, message = run(capsys, *command, "--overwrite")
    assert found == code and expected.format(out=tmp_path / "out") in message
    assert ("Traceback" in message) == (code == 1)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before
    assert run(capsys, *command)[0] == 2, "and without --overwrite nothing is even tried"


@pytest.mark.skipif(sys.platform != "linux", reason="names that are not UTF-8 are refused elsewhere")
def test_names_that_are_not_utf8_cost_no_results(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, out = tmp_path / os.fsdecode(b"s\xff"), tmp_path / os.fsdecode(b"o\xff")
    write_native(folder, make_sequence(count=2))
    sys.stdout.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]
    code, message = run(capsys, "run", folder, "--output", out)
    assert code == 0, message
    assert Path(json.loads((out / "report.json").read_text())["sequence"]["path"]) == folder
    assert run(capsys, "evaluate", out)[0] == 0


@pytest.mark.skipif(sys.platform != "linux" or os.geteuid() != 0, reason="only root mounts a small disk")
@pytest.mark.parametrize("options", [(), ("--no-rerun",)])
def test_a_full_disk_ends_a_run_in_one_line(tmp_path: Path, options: tuple[str, ...]) -> None:
    write_native(tmp_path / "sequence", make_sequence(count=3))
    disk = tmp_path / "disk"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=16k", "tmpfs", str(disk)], check=False).returncode:
        pytest.skip("no small disk can be mounted")
    try:
        command = [sys.executable, "-m", "asfm", "run", str(tmp_path / "sequence"), "--output", str(disk / "out")]
        done = subprocess.run([*command, *options], capture_output=True, text=True, timeout=60, check=False)
        last = done.stderr.splitlines()[-1]
        assert done.returncode == 2 and "cannot write" in last and "No space left on device" in last, done.stderr
        assert list(disk.iterdir()) == []
    finally:
        subprocess.run(["umount", str(disk)], check=True)
