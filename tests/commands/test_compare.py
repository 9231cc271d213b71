"""``asfm compare``: runs side by side, what is read and what is evaluated, and one line for what cannot be compared."""

import csv
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from asfm.cli import run_command_line
from asfm.commands import compare as module
from asfm.commands import compare_folders, evaluate
from asfm.errors import AsfmError

Ask = Callable[..., str]


@pytest.fixture
def results(demo_folder: Path, tmp_path: Path) -> Path:
    return copy_run(demo_folder, tmp_path / "first")


def copy_run(demo_folder: Path, folder: Path) -> Path:
    """Copy the results of the demo; its evaluation, which the run wrote before its report, stays the older file."""
    shutil.copytree(demo_folder / "results", folder)
    return folder


def edit_report(folder: Path, **changes: Any) -> None:
    path = folder / "report.json"
    report = json.loads(path.read_text())
    report["sequence"] |= changes.pop("sequence", {})
    path.write_text(json.dumps(report | changes))


def refuse(capsys: Any, *arguments: object) -> str:
    capsys.readouterr()
    assert run_command_line(["compare", *map(str, arguments)]) == 2
    lines: list[str] = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("evaluate: ")]
    assert len(lines) == 1 and lines[0].startswith("asfm: ")
    return lines[0]


def test_runs_are_set_side_by_side(demo_folder: Path, results: Path, tmp_path: Path, ask: Ask) -> None:
    second = copy_run(demo_folder, tmp_path / "second")
    text = (second / "config.yaml").read_text()
    (second / "config.yaml").write_text(text.replace("detector: akaze", "detector: orb"))
    edit_report(second, wall_s=77.0)
    output = tmp_path / "table"
    text = ask("compare", results, second, "--output", output)
    header, first_row, second_row, *rest = text.splitlines()
    assert header.split()[:3] == ["run", "sequence", "matcher"]
    assert first_row.startswith("first") and " akaze, mutual+ratio+arc+planar+ssl " in first_row
    assert second_row.startswith("second") and " orb, " in second_row and second_row.endswith(" 77.0")
    assert "-" not in first_row.split() and not any("different sequences" in line for line in rest)
    with (output / "comparison.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    evaluation = {row["key"]: row for row in json.loads((results / "evaluation.json").read_text())["rows"]}
    for column, key in (
        ("precision", "match_precision_overall"),
        ("recall", "match_recall_overall"),
        ("arc_inlier_ratio", "match_arc_inlier_ratio_overall"),
        ("ate_m", "ate_rmse_m_se3"),
        ("ate_over_bound", "ate_over_bound"),
        ("nees_position", "nees_position"),
    ):
        assert float(rows[0][column]) == pytest.approx(evaluation[key]["value"])
    assert float(rows[0]["ate_over_odometry"]) == pytest.approx(evaluation["ate_rmse_m_se3"]["ratio"])
    assert {path.suffix for path in output.iterdir()} == {".csv", ".svg", ".png"}
    assert "already holds a comparison" in refuse_output(results, output)
    ask("compare", results, "--output", output, "--overwrite")


def refuse_output(results: Path, output: Path) -> str:
    with pytest.raises(AsfmError) as caught:
        compare_folders([results], output)
    return str(caught.value)


def test_an_evaluation_against_another_reference_is_named(results: Path, ask: Any) -> None:
    ask("evaluate", results, "--reference", results / "trajectory.tum")
    (note,) = (note for note in compare_folders([results]).notes if "in place of the true poses" in note)
    assert note.startswith(f"{results.name}: compared with {(results / 'trajectory.tum').resolve()}")
    ask("evaluate", results)
    assert not [note for note in compare_folders([results]).notes if "in place of" in note]


def test_a_newer_evaluation_is_read_and_an_older_one_made_anew(results: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = []

    def count(folder: Path) -> Any:
        made.append(folder)
        return compare_with_truth(folder)

    compare_with_truth = evaluate.compare_with_truth
    monkeypatch.setattr(module, "compare_with_truth", count)
    first = compare_folders([results]).runs[0]
    assert made == [results] and first.precision is not None
    assert compare_folders([results]).runs[0] == first and len(made) == 1
    os.utime(results / "evaluation.json", ns=(0, (results / "report.json").stat().st_mtime_ns))
    assert compare_folders([results]).runs[0] == first and len(made) == 2
    (results / "evaluation.json").unlink()
    assert compare_folders([results]).runs[0] == first and len(made) == 3


def test_different_sequences_are_said(demo_folder: Path, results: Path, tmp_path: Path, ask: Ask) -> None:
    second, elsewhere = copy_run(demo_folder, tmp_path / "second"), tmp_path / "elsewhere" / "seafloor"
    shutil.copytree(demo_folder / "seafloor", elsewhere)
    edit_report(second, sequence={"path": str(elsewhere)})
    text = ask("compare", results, second)
    assert "note: The runs are of 2 different sequences" in text and str(elsewhere) in text
    third = copy_run(demo_folder, tmp_path / "third")
    config = (third / "config.yaml").read_text()
    (third / "config.yaml").write_text(config.replace("  every: 1", "  every: 2"))
    runs = compare_folders([results, third])
    assert "frames 0- every 2" in runs.runs[1].labels.sequence and "2 different sequences" in runs.notes[0]


def test_a_run_that_cannot_be_evaluated_has_dashes_and_a_note(
    demo_folder: Path, results: Path, tmp_path: Path, ask: Ask
) -> None:
    gone = copy_run(demo_folder, tmp_path / "gone")
    edit_report(gone, sequence={"path": str(tmp_path / "nowhere")})
    _, row, other, *rest = ask("compare", gone, results).splitlines()
    assert row.split().count("-") == 7 and "-" not in other.split(), "ATE and its ratio to the odometry are known"
    assert any(line.startswith("note: gone: only what the run itself evaluated: ") for line in rest)
    (gone / "evaluation.json").unlink()
    _, row, _, *rest = ask("compare", gone, results).splitlines()
    assert row.split().count("-") == 9
    assert any(line.startswith("note: gone: not evaluated: ") for line in rest)


def test_external_keypoints_are_named(results: Path, tmp_path: Path) -> None:
    edit_report(results, external_matches=[str(tmp_path / "lightglue" / "features.h5"), "matches.h5"])
    assert compare_folders([results]).runs[0].labels.matcher.startswith("external lightglue/features.h5, ")


def test_runs_of_one_name_are_told_apart_by_their_paths(demo_folder: Path, tmp_path: Path) -> None:
    folders = [copy_run(demo_folder, tmp_path / place / "run") for place in ("a", "b")]
    assert [run.labels.run for run in compare_folders(folders).runs] == [str(folder) for folder in folders]


def test_what_cannot_be_compared_is_a_one_line_error(results: Path, tmp_path: Path, capsys: Any) -> None:
    assert "expected each results folder once, found it 2 times" in refuse(capsys, results, f"{results}/../first")
    assert "found no report.json in it" in refuse(capsys, results, tmp_path)
    assert "nothing: expected a folder that asfm run wrote" in refuse(capsys, tmp_path / "nothing")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("keep")
    assert "expected an empty place, found mine.txt" in refuse(capsys, results, "--output", tmp_path / "full")
    evaluation = results / "evaluation.json"
    evaluation.write_text("{}")
    os.utime(evaluation, ns=(2**62, 2**62))
    assert "evaluation.json: expected an evaluation" in refuse(capsys, results)
    (results / "config.yaml").unlink()
    assert "found no config.yaml in it" in refuse(capsys, results)


def test_a_folder_that_takes_no_evaluation_is_compared_all_the_same(
    results: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(folder: Path, table: object) -> None:
        raise AsfmError("evaluation.json: cannot write: Read-only file system")

    monkeypatch.setattr(module, "write_evaluation", fail)
    found = compare_folders([results])
    assert found.runs[0].precision is not None and "Read-only" in found.notes[-1]
