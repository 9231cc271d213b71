"""Runs of studies: every kind of cell, resuming after kill -9, folders that are in use or hold something else."""

import csv
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from asfm.cli import run_command_line
from asfm.commands import run_study
from asfm.errors import AsfmError
from asfm.folder_lock import lock_folder
from asfm.study.match_pictures import PICTURES
from asfm.study.study_run import RunSettings, compute_cells, load_grid
from tests.study.conftest import run_asfm

LARGEST_WAIT_S = 120


def read_table(folder: Path) -> list[dict[str, str]]:
    with (folder / "results.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def without_seconds(folder: Path) -> list[dict[str, str]]:
    return [{name: value for name, value in row.items() if name != "seconds"} for row in read_table(folder)]


def test_every_cell_has_its_row_in_the_order_of_the_grid(study_folder: Path) -> None:
    rows = read_table(study_folder / "results")
    axes = [(row["detector"], row["filters"], row["wrong_share"], row["seed"]) for row in rows]
    matchers = [("akaze", "ratio", ""), ("akaze", "every", ""), ("corners", "ratio", ""), ("corners", "every", "")]
    matchers += [("broken", "ratio", ""), ("broken", "every", "")]
    matchers += [("true matches", "none", "0.0"), ("true matches", "none", "0.3")]
    assert axes == [(*matcher, seed) for seed in "01" for matcher in matchers]
    for row in rows:
        if row["detector"] == "broken":
            assert "the function raised ArithmeticError" in row["error"] and "no features today" in row["error"]
            assert not row["ate_m"] and not row["precision"]
        else:
            assert not row["error"], row
            assert float(row["ate_m"]) > 0 and float(row["bound_ate_m"]) > 0 and 0 < float(row["precision"]) <= 1
            assert float(row["ate_over_bound"]) == pytest.approx(float(row["ate_m"]) / float(row["bound_ate_m"]))
            odometry_m = float(row["odometry_ate_m"])
            assert float(row["ate_over_odometry"]) == pytest.approx(float(row["ate_m"]) / odometry_m)
            assert row["mirror_aware"] == "False" and float(row["stationary_ate_m"]) > 0
    by_name = {(row["detector"], row["filters"], row["wrong_share"], row["seed"]): row for row in rows}
    every, ratio = (int(by_name["akaze", name, "", "0"]["matches"]) for name in ("every", "ratio"))
    assert every < ratio, "more filters leave fewer matches"
    true, wrong = (by_name["true matches", "none", share, "0"] for share in ("0.0", "0.3"))
    assert float(true["precision"]) == 1 and float(wrong["precision"]) == pytest.approx(0.7, abs=0.03)
    for name in ("odometry_ate_m", "precision"):
        values = [by_name["akaze", "every", "", seed][name] for seed in "01"]
        assert values[0] != values[1], f"the seed changes {name}"
    assert not list((study_folder / "results").glob("logs/*")), "a matcher that raises is no defect of asfm"


def read_pictures(results: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in (results / PICTURES).glob("[!.]*")}


def test_every_matcher_and_chain_has_a_picture_of_seed_0_in_the_report(study_folder: Path) -> None:
    results = study_folder / "results"
    rows = [row for row in read_table(results) if not row["error"] and not row["wrong_share"] and row["seed"] == "0"]
    pictures = read_pictures(results)
    (image,) = (name for name in pictures if name.endswith(".jpg"))
    assert {f"{row['cell']}.json" for row in rows} == set(pictures) - {image} and len(rows) == 4
    page = (results / "report.html").read_text()
    assert page.count("frames 0 and 3</figcaption>") == 4, "also that of a chain without a match between these"
    assert page.count("data:image/jpeg;base64,") == 1, "the image is shared"
    assert all(float(row["precision_gap_2"]) > 0 and not row["precision_gap_8"] for row in rows)


def test_features_are_computed_once_for_all_chains(study_folder: Path) -> None:
    cache = study_folder / "results" / "cache"
    count = {kind.name: len([entry for entry in kind.iterdir() if entry.is_dir()]) for kind in cache.iterdir()}
    assert count == {"sequences": 2, "features": 2, "external": 2, "true-tracks": 1}


def test_a_study_killed_in_the_middle_goes_on_where_it_was(study_folder: Path, tmp_path: Path) -> None:
    for name in ("study.yaml", "study_matchers.py"):
        shutil.copy(study_folder / name, tmp_path)
    cells = tmp_path / "results" / "cells"
    process = run_asfm(tmp_path, "study", "study.yaml", "--output", "results", "--jobs", "1", start=True)
    deadline_s = time.monotonic() + LARGEST_WAIT_S
    while len(list(cells.glob("*.parquet"))) < 3 and time.monotonic() < deadline_s and process.poll() is None:
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    time.sleep(0.5)  # the worker notices that its parent is gone
    finished = {path.name: path.stat().st_mtime_ns for path in cells.glob("*.parquet")}
    assert 3 <= len(finished) < 16
    (cells / ".half.parquet.1.partial").write_bytes(b"PAR1")
    run_asfm(tmp_path, "study", "study.yaml", "--output", "results")
    after = {path.name: path.stat().st_mtime_ns for path in cells.iterdir()}
    assert {name: after[name] for name in finished} == finished, "no finished cell is computed twice"
    assert len(after) == 16 and not list(cells.glob(".*"))
    assert without_seconds(tmp_path / "results") == without_seconds(study_folder / "results")
    assert read_pictures(tmp_path / "results") == read_pictures(study_folder / "results")


def test_a_finished_study_is_not_computed_again(study_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(study_folder))
    results = study_folder / "results"
    cells_before = {path.name: path.read_bytes() for path in (results / "cells").iterdir()}
    before = read_table(results)
    study, cells = load_grid(study_folder / "study.yaml")
    assert compute_cells(study, cells, results).computed == 0
    assert {path.name: path.read_bytes() for path in (results / "cells").iterdir()} == cells_before
    assert read_table(results) == before


def test_failed_cells_are_computed_again_where_that_is_asked_for(
    study_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(study_folder))
    shutil.copytree(study_folder / "results", tmp_path / "results")
    study, cells = load_grid(study_folder / "study.yaml")
    results = compute_cells(study, cells, tmp_path / "results", RunSettings(1, retry_failed=True))
    assert results.computed == 4 and sum(row["error"] is not None for row in results.rows) == 4


def test_folders_of_others_are_refused(study_folder: Path, tmp_path: Path, capsys: Any) -> None:
    def refuse(path: Path, output: Path) -> str:
        assert run_command_line(["study", str(path), "--output", str(output)]) == 2
        message = str(capsys.readouterr().err)
        assert message.count("\n") == 1
        return message

    other = tmp_path / "other.yaml"
    other.write_text("simulate: {scenes: [tank], sonars: [didson], frames: 2}\ndetectors: [orb]\n")
    assert "holds another study" in refuse(other, study_folder / "results")
    (tmp_path / "used").mkdir()
    (tmp_path / "used" / "letters.txt").write_text("x")
    assert "expected an empty folder or that of the same study, found letters.txt" in refuse(other, tmp_path / "used")
    folder = tmp_path / "busy"
    folder.mkdir()
    with lock_folder(folder) as locked:
        assert locked
        assert "another asfm study is at work" in refuse(other, folder)
    with pytest.raises(AsfmError, match="expected at least one process"):
        compute_cells(*load_grid(other), tmp_path / "new", RunSettings(jobs=0))


def test_parquet_and_csv_say_the_same(study_folder: Path) -> None:
    from pyarrow import parquet

    table = parquet.ParquetFile(study_folder / "results" / "results.parquet").read().to_pylist()
    for row, text in zip(table, read_table(study_folder / "results"), strict=True):
        assert {name: "" if value is None else str(value) for name, value in row.items()} == text
    assert np.isfinite([row["seconds"] for row in table]).all()
    assert list((study_folder / "results" / "figures").iterdir())


def test_a_finished_study_prints_its_table_and_writes_its_report_again(
    study_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.syspath_prepend(str(study_folder))
    results = tmp_path / "results"
    shutil.copytree(study_folder / "results", results)
    (results / "report.html").unlink()
    assert run_command_line(["study", str(study_folder / "study.yaml"), "--output", str(results)]) == 0
    text = capsys.readouterr().out
    assert "16 cells, 0 computed now, 4 failed" in text and "the function raised ArithmeticError" in text
    assert text.splitlines()[0].split()[:3] == ["matcher", "filters", "mode"] and "corners" in text
    assert (results / "report.html").is_file(), "the report is written again"
    summary = run_study(study_folder / "study.yaml", results)
    assert summary.computed == 0 and len(summary.rows) == 16 and summary.law is None


@pytest.mark.skipif(sys.platform != "linux" or os.geteuid() != 0, reason="only root mounts a small disk")
def test_a_full_disk_ends_a_study_that_goes_on_when_there_is_room(tmp_path: Path) -> None:
    study = "simulate: {scenes: [tank], sonars: [didson], frames: 4}\nseeds: 4\nmodes: [odometry]\ndetectors: [akaze]\n"
    (tmp_path / "study.yaml").write_text(study + "bound_draws: 0\n")
    disk, results = tmp_path / "disk", tmp_path / "disk" / "results"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=16k", "tmpfs", str(disk)], check=False).returncode:
        pytest.skip("no small disk can be mounted")
    try:
        for size, finished in (("1200k", 1), ("1m", 1)):
            subprocess.run(["mount", "-o", f"remount,size={size}", str(disk)], check=True)
            process = run_asfm(tmp_path, "study", "study.yaml", "--output", "disk/results", "--jobs", "1", start=True)
            _, message = process.communicate()
            last = message.splitlines()[-1]
            assert process.returncode == 2 and "Traceback" not in message, message
            assert "No space left on device" in last and "make room, and run the study again" in last
            assert len(list((results / "cells").iterdir())) >= finished and not (results / "results.csv").exists()
        subprocess.run(["mount", "-o", "remount,size=50m", str(disk)], check=True)
        run_asfm(tmp_path, "study", "study.yaml", "--output", "disk/results", "--jobs", "1")
        rows = read_table(results)
        assert [row["seed"] for row in rows] == list("0123") and not any(row["error"] for row in rows)
    finally:
        subprocess.run(["umount", str(disk)], check=True)
