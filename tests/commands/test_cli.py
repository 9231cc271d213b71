"""The command line: what it answers, what it writes, and that the README tells the truth about it."""

import json
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer

from asfm import __version__
from asfm.cli import app, main, run_command_line
from asfm.commands import convert_sequence, evaluate_folder, run_demo, simulate_to
from asfm.config import Config
from asfm.config_file import load_config
from asfm.datasets import open_sequence, open_truth
from asfm.datasets.tables import read_tum
from asfm.simulation.scenes.catalogue import SCENES
from asfm.simulation.sonars.presets import PRESETS

ROOT = Path(__file__).resolve().parents[2]
FRAMES = 6


@pytest.fixture(scope="module")
def demo_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small demo: a simulated sequence and the results of its run."""
    folder = tmp_path_factory.mktemp("demo")
    run_demo(folder, frames=FRAMES)
    return folder


def ask(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> str:
    """Run a command line that must succeed; gives what it printed."""
    capsys.readouterr()
    assert run_command_line([str(argument) for argument in arguments]) == 0, capsys.readouterr().err
    return capsys.readouterr().out


@pytest.mark.parametrize(("argument", "answer"), [("--version", f"asfm {__version__}\n"), ("--help", "Usage: asfm")])
def test_version_and_help_answer_without_loading_anything(argument: str, answer: str) -> None:
    code = "import sys; from asfm.cli import run_command_line; code = run_command_line(sys.argv[1:])\n"
    code += "print(*[name for name in ('numpy', 'pydantic', 'yaml', 'rich', 'asfm.commands') if name in sys.modules])"
    found = subprocess.run([sys.executable, "-c", code, argument], capture_output=True, text=True, check=True)
    assert found.stdout.startswith(answer)
    assert found.stdout.splitlines()[-1] == "", "heavy modules were loaded"


def test_the_module_and_the_installed_command_are_the_same(capsys: pytest.CaptureFixture[str]) -> None:
    found = subprocess.run([sys.executable, "-m", "asfm", "rum"], capture_output=True, text=True, check=False)
    assert (found.returncode, found.stdout) == (2, "")
    assert found.stderr == "asfm: No such command 'rum'. Did you mean 'run'?; see asfm --help\n"
    with pytest.raises(SystemExit) as left:
        main(["--version"])
    assert left.value.code == 0 and __version__ in capsys.readouterr().out


def test_without_arguments_it_explains_itself(capsys: pytest.CaptureFixture[str]) -> None:
    text = ask(capsys)
    assert all(f"  {name} " in text for name in ("run", "info", "evaluate", "view", "simulate", "convert", "demo"))
    assert "..." not in text.partition("Commands:")[2], "every command's line fits"


def test_a_run_writes_all_results(demo_folder: Path) -> None:
    results = demo_folder / "results"
    names = {"trajectory.tum", "points.ply", "pose_sigmas.csv", "tracks.csv", "reconstruction.rrd"}
    names |= {"report.json", "config.yaml", "evaluation.json"}
    assert {path.name for path in results.iterdir()} == names
    assert load_config(results / "config.yaml") == Config()
    report = json.loads((results / "report.json").read_text())
    assert report["sequence"] == {
        "path": str(demo_folder / "seafloor"),
        "name": "seafloor",
        "format": "native",
        "frames": FRAMES,
    }
    assert report["seed"] == 0 and report["counts"]["poses"] == FRAMES and report["counts"]["landmarks"] > 0
    assert report["versions"]["asfm"] == __version__ and report["versions"]["numpy"] == np.__version__
    assert all(report["versions"].values())
    assert 0 < sum(stage["wall_s"] for stage in report["stages"]) <= report["wall_s"]
    assert all(50 < stage["peak_memory_mb"] < 5000 for stage in report["stages"])
    assert report["stages"][0]["counts"]["frames"] == FRAMES


def test_the_demo_repeats_itself_byte_by_byte(demo_folder: Path, tmp_path: Path, capsys: Any) -> None:
    text = ask(capsys, "demo", "--frames", str(FRAMES), "--output", tmp_path / "again")
    results = tmp_path / "again" / "results"
    assert f"asfm view {results}\n" in text and "ATE RMSE, SE(3)-aligned, scale off: " in text
    for name in ("trajectory.tum", "points.ply", "pose_sigmas.csv", "tracks.csv", "config.yaml", "evaluation.json"):
        assert (results / name).read_bytes() == (demo_folder / "results" / name).read_bytes(), name
    ask(capsys, "demo", "--frames", "2", "--output", tmp_path / "again")
    assert len(np.loadtxt(results / "trajectory.tum")) == 2, "an earlier demo is replaced"


def test_settings_come_from_file_and_command_line(demo_folder: Path, tmp_path: Path, capsys: Any) -> None:
    (tmp_path / "mine.yaml").write_text("backend: {rounds: 2}\nseed: 3\n")
    command: list[str | Path] = [
        "run",
        demo_folder / "seafloor",
        "--output",
        tmp_path / "out",
        "--config",
        tmp_path / "mine.yaml",
    ]
    text = ask(capsys, *command, "--set", "seed=4", "--set", "cfar.guard_px=[3, 3]", "--mode", "batch", "--no-rerun")
    assert "reconstruction.rrd" not in {path.name for path in (tmp_path / "out").iterdir()}
    assert "asfm view" not in text, "there is nothing to look at"
    resolved = load_config(tmp_path / "out" / "config.yaml")
    assert (resolved.backend.rounds, resolved.seed, resolved.cfar.guard_px) == (2, 4, (3, 3))
    assert json.loads((tmp_path / "out" / "report.json").read_text())["seed"] == 4


@pytest.mark.parametrize(
    ("name", "frames", "shares_nothing"),
    [("aris/sample.aris", 6, True), ("turtle_sim", 60, False), ("holoocean_boat", 60, True)],
)
def test_recordings_that_share_little_run_to_the_end(
    shared_data: Path, tmp_path: Path, name: str, frames: int, shares_nothing: bool, capsys: Any
) -> None:
    assert run_command_line(["run", str(shared_data / name), "--output", str(tmp_path / "out"), "--no-rerun"]) == 0
    rows = np.loadtxt(tmp_path / "out" / "trajectory.tum")
    assert rows.shape == (frames, 8) and np.isfinite(rows).all()
    if shares_nothing:
        assert "warning: " in capsys.readouterr().err


def test_evaluation_names_alignment_and_sets_the_odometry_beside(demo_folder: Path, capsys: Any) -> None:
    results = demo_folder / "results"
    before = json.loads((results / "evaluation.json").read_text())
    (results / "evaluation.json").unlink()
    text = ask(capsys, "evaluate", results)
    header, *lines = text.splitlines()
    assert header.split() == ["measure", "run", "unit", "odometry", "ratio"]
    row = next(line for line in lines if line.startswith("ATE RMSE, SE(3)-aligned, scale off"))
    run_m, unit, odometry_m, ratio = row.split("scale off")[1].split()
    assert unit == "m" and float(ratio) == pytest.approx(float(run_m) / float(odometry_m), abs=0.01)
    after = json.loads((results / "evaluation.json").read_text())
    assert after["notes"] == before["notes"]
    assert after["rows"][: len(before["rows"])] == before["rows"], "asfm run wrote the same, but for the bound"
    table = evaluate_folder(results)
    assert table.row("ATE RMSE, SE(3)-aligned, scale off").value == pytest.approx(float(run_m), abs=5e-5)


def test_evaluation_sets_a_simulated_run_over_its_bound(demo_folder: Path, tmp_path: Path, capsys: Any) -> None:
    results = tmp_path / "results"
    shutil.copytree(demo_folder / "results", results)
    text = ask(capsys, "evaluate", results)
    bound_m, ate_over_bound = (
        float(next(line for line in text.splitlines() if line.startswith(name)).split("scale off")[1].split()[0])
        for name in ("bound (true associations, ideal points), SE(3)-aligned", "ATE / bound, SE(3)-aligned")
    )
    ate_m = evaluate_folder(results).row("ATE RMSE, SE(3)-aligned, scale off").value
    assert bound_m > 0 and ate_over_bound == pytest.approx(ate_m / bound_m, rel=0.05)
    assert '"name": "ATE / bound' in (results / "evaluation.json").read_text()
    assert "bound" not in ask(capsys, "evaluate", results, "--reference", results / "trajectory.tum")
    table = (results / "tracks.csv").read_text()
    (results / "tracks.csv").write_text(table.replace(",1\n", ",yes\n", 1))
    assert run_command_line(["evaluate", str(results)]) == 2
    message = capsys.readouterr().err
    assert "tracks.csv, line " in message and "as used, found 'yes'" in message and message.count("\n") == 1
    (results / "tracks.csv").unlink()
    text = ask(capsys, "evaluate", results)
    assert "note: No bound: the results hold no tracks.csv" in text and "ATE / bound" not in text


def test_a_reference_stands_in_for_the_truth(demo_folder: Path, tmp_path: Path, capsys: Any) -> None:
    results = tmp_path / "results"
    ask(capsys, "run", demo_folder / "seafloor", "--output", results, "--no-rerun")
    table = evaluate_folder(results, results / "trajectory.tum")
    assert table.row("ATE RMSE, SE(3)-aligned, scale off").value == pytest.approx(0, abs=1e-9)
    report = json.loads((results / "report.json").read_text())
    report["sequence"]["path"] = str(tmp_path / "gone")
    (results / "report.json").write_text(json.dumps(report))
    assert run_command_line(["evaluate", str(results)]) == 2
    message = capsys.readouterr().err
    assert "gone: expected a sequence" in message and "--reference" in message and message.count("\n") == 1
    text = ask(capsys, "evaluate", results, "--reference", results / "trajectory.tum")
    assert "note: Without the odometry's row: " in text
    for content, said in (("{", "expected JSON"), ("[]", "no sequence in it"), ('{"sequence": {}}', "path")):
        (results / "report.json").write_text(content)
        assert run_command_line(["evaluate", str(results)]) == 2
        assert said in capsys.readouterr().err
    assert run_command_line(["evaluate", str(tmp_path)]) == 2
    assert "found no report.json in it" in capsys.readouterr().err


def test_info_tells_what_a_sequence_holds(demo_folder: Path, capsys: Any) -> None:
    rows = dict(
        re.split(r"  +", line, maxsplit=1) for line in ask(capsys, "info", demo_folder / "seafloor").splitlines()
    )
    assert rows["frames"] == str(FRAMES) and rows["format"] == "native"
    assert rows["image"] == "600 ranges x 256 beams" and rows["ground truth"].startswith(f"{FRAMES} poses")


def test_view_opens_the_recording(demo_folder: Path, tmp_path: Path, capsys: Any, monkeypatch: Any) -> None:
    opened: list[Path] = []

    def open_viewer(path: Path) -> int:
        opened.append(path)
        return 0

    monkeypatch.setattr("asfm.visualization.rerun_recorder.open_viewer", open_viewer)
    ask(capsys, "view", demo_folder / "results")
    ask(capsys, "view", demo_folder / "results" / "reconstruction.rrd")
    assert opened == [demo_folder / "results" / "reconstruction.rrd"] * 2
    monkeypatch.setattr("asfm.visualization.rerun_recorder.open_viewer", lambda path: 3)
    assert run_command_line(["view", str(demo_folder / "results")]) == 2
    assert "ended with code 3" in capsys.readouterr().err
    monkeypatch.undo()
    assert run_command_line(["view", str(tmp_path)]) == 2
    assert "expected a recording" in capsys.readouterr().err


def test_simulate_writes_a_sequence_with_truth(tmp_path: Path, capsys: Any) -> None:
    text = ask(capsys, "simulate", "seafloor", "--output", tmp_path / "a", "--frames", "2", "--sonar", "aris_3000")
    assert f"asfm run {tmp_path / 'a'} --output" in text
    sequence, read_truth = open_sequence(tmp_path / "a"), open_truth(tmp_path / "a")
    assert len(sequence) == 2 and sequence.sonar.shape[1] == 128 and sequence.groundtruth is not None
    assert read_truth is not None and np.isfinite(read_truth(1).elevation_rad).any()
    simulate_to("seafloor", tmp_path / "b", "aris_3000", frames=2)
    for path in sorted(path for path in (tmp_path / "a").rglob("*") if path.is_file()):
        assert path.read_bytes() == (tmp_path / "b" / path.relative_to(tmp_path / "a")).read_bytes(), path.name
    assert run_command_line(["simulate", "seafloor", "--output", str(tmp_path / "a"), "--frames", "1"]) == 2
    assert "already holds a sequence" in capsys.readouterr().err
    ask(capsys, "simulate", "seafloor", "--output", tmp_path / "a", "--frames", "1", "--overwrite")
    assert len(open_sequence(tmp_path / "a")) == 1


def test_simulate_takes_its_scene_as_an_option_too(tmp_path: Path, capsys: Any) -> None:
    text = ask(capsys, "simulate", "--scene", "tank", "--output", tmp_path / "a", "--frames", "1")
    assert text.startswith("1 frame in")
    for both in (["tank", "--scene", "pier"], []):
        assert run_command_line(["simulate", *both, "--output", str(tmp_path / "b")]) == 2
        assert "expected one scene" in capsys.readouterr().err


def test_simulate_follows_a_motion_or_a_path(demo_folder: Path, tmp_path: Path, capsys: Any) -> None:
    still, along = tmp_path / "still", tmp_path / "along"
    ask(capsys, "simulate", "seafloor", "--output", still, "--frames", "2", "--motion", "static")
    truth = open_sequence(still).groundtruth
    assert truth is not None and np.array_equal(truth.world_from_vehicle[0], truth.world_from_vehicle[1])
    path = demo_folder / "seafloor" / "groundtruth.tum"
    text = ask(capsys, "simulate", "seafloor", "--output", along, "--motion", path)
    truth, expected = open_sequence(along).groundtruth, read_tum(path)
    assert truth is not None and text.startswith(f"{len(truth.timestamps_s)} frames in ")
    assert FRAMES - 1 <= len(truth.timestamps_s) <= FRAMES, "the path ends before 80 frames"
    np.testing.assert_allclose(truth.world_from_vehicle[:2], expected.world_from_vehicle[:2], atol=1e-5)
    for motion, said in (("flight", "unknown motion 'flight'; known: "), ("gone.tum", "gone.tum")):
        arguments = ["simulate", "seafloor", "--output", str(tmp_path / "out"), "--motion", motion]
        assert run_command_line(arguments) == 2
        message = capsys.readouterr().err
        assert said in message and message.count("\n") == 1


def test_simulate_says_what_it_warns_of(tmp_path: Path, capsys: Any) -> None:
    away = tmp_path / "away.tum"
    away.write_text("0 0 0 2 0 -0.5 0 0.8660254\n1 0 0 2 0 -0.5 0 0.8660254\n")  # looks up
    arguments = ["simulate", "seafloor", "--output", str(tmp_path / "out"), "--frames", "2", "--motion", str(away)]
    assert run_command_line(arguments) == 0
    assert "warning: 2 of 2 frames see nothing of seafloor within " in capsys.readouterr().err


def test_simulate_writes_what_holoocean_would(tmp_path: Path, capsys: Any) -> None:
    common = ("simulate", "tank", "--frames", "2", "--sonar", "holoocean")
    ask(capsys, *common, "--output", tmp_path / "pickles", "--format", "holoocean")
    ask(capsys, *common, "--output", tmp_path / "native")
    pickles, native = open_sequence(tmp_path / "pickles"), open_sequence(tmp_path / "native")
    assert (pickles.kind, native.kind) == ("holoocean", "native")
    for one, other in zip(pickles, native, strict=True):
        np.testing.assert_allclose(one.image, other.image, atol=0.5 / 255 + 1e-6)
    assert run_command_line([*common, "--output", str(tmp_path / "out"), "--format", "rosbag"]) == 2
    message = capsys.readouterr().err
    assert "known: native, holoocean" in message and message.count("\n") == 1


def test_wrong_names_are_answered_with_the_right_ones(tmp_path: Path, capsys: Any) -> None:
    assert run_command_line(["simulate", "moon", "--output", str(tmp_path / "out")]) == 2
    message = capsys.readouterr().err
    assert all(name in message for name in SCENES) and message.count("\n") == 1
    assert run_command_line(["simulate", "pier", "--output", str(tmp_path / "out"), "--sonar", "ear"]) == 2
    message = capsys.readouterr().err
    assert all(name in message for name in PRESETS) and message.count("\n") == 1
    for option in ("--frames", "--seed"):
        assert run_command_line(["simulate", "pier", "--output", str(tmp_path / "out"), option, "-1"]) == 2
        assert "-1" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_convert_keeps_what_it_reads(demo_folder: Path, tmp_path: Path, capsys: Any) -> None:
    ask(capsys, "convert", demo_folder / "seafloor", tmp_path / "copy")
    source, copy = open_sequence(demo_folder / "seafloor"), open_sequence(tmp_path / "copy")
    for before, after in zip(source, copy, strict=True):
        np.testing.assert_array_equal(after.image, before.image)
    assert (tmp_path / "copy" / "truth" / "000001.npz").is_file()
    convert_sequence(demo_folder / "seafloor", tmp_path / "fine", bits=16)
    convert_sequence(tmp_path / "fine", tmp_path / "coarse")
    sizes = [(tmp_path / name / "frames" / "000000.png").stat().st_size for name in ("copy", "fine", "coarse")]
    assert sizes[0] == sizes[2] < sizes[1], "16 bits only where 8 would lose something"


def test_progress_is_a_line_a_stage_where_nobody_watches(demo_folder: Path, tmp_path: Path, capsys: Any) -> None:
    ask(capsys, "convert", demo_folder / "seafloor", tmp_path / "one")
    capsys.readouterr()
    assert run_command_line(["convert", str(demo_folder / "seafloor"), str(tmp_path / "two")]) == 0
    assert capsys.readouterr().err == f"convert: {FRAMES} steps\n"


def test_progress_is_a_bar_on_a_terminal(
    demo_folder: Path, tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    assert run_command_line(["convert", str(demo_folder / "seafloor"), str(tmp_path / "out")]) == 0
    assert f"{FRAMES}/{FRAMES}" in capsys.readouterr().err


def test_a_closed_pipe_is_no_fault(demo_folder: Path) -> None:
    command = f"{shlex.quote(sys.executable)} -m asfm info {shlex.quote(str(demo_folder / 'seafloor'))} | true"
    found = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert found.stderr == ""


# The README.


def readme_commands() -> Iterator[str]:
    """Every line of a code block in the README that calls asfm, continued lines joined."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    for block in re.findall(r"^```[^\n]*\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL):
        for line in block.replace("\\\n", " ").splitlines():
            program, _, arguments = line.strip().removeprefix("$ ").partition(" ")
            if Path(program).name == "asfm":
                yield shlex.join(shlex.split(arguments, comments=True))


def parse(line: str) -> None:
    """Parse a command line as asfm would, without running it."""
    group: Any = typer.main.get_command(app)
    name, *arguments = shlex.split(line) or ["--help"]
    if name.startswith("-"):
        assert name in ("--help", "--version", "-h")
        return
    assert name in group.commands, f"asfm {name} does not exist"
    group.commands[name].make_context(f"asfm {name}", arguments)


def test_every_command_of_the_readme_parses() -> None:
    commands = list(readme_commands())
    assert commands, "the README shows no command"
    for line in commands:
        parse(line)


@pytest.mark.parametrize("line", ["study x.yaml", "run", "run sequence --output out --colour", "demo --frames many"])
def test_a_wrong_line_in_the_readme_would_be_seen(line: str) -> None:
    with pytest.raises(Exception, match=r"does not exist|Missing|No such option|valid integer"):
        parse(line)


def test_make_and_ci_are_there() -> None:
    makefile = (ROOT / "Makefile").read_text()
    assert re.search(r"^demo:", makefile, re.MULTILINE) and re.search(r"^test:", makefile, re.MULTILINE)
    assert "make test" in (ROOT / ".ci" / "run").read_text()
    assert (ROOT / ".ci" / "run").stat().st_mode & 0o111
