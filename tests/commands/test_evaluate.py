"""``asfm evaluate``: alignment, odometry, bound and reference."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from asfm.cli import run_command_line
from asfm.commands import evaluate_folder
from asfm.datasets.tables import read_tum
from asfm.geometry.local_origin import shift_trajectory
from asfm.geometry.poses import tum_from_pose

Ask = Callable[..., str]


def test_evaluation_states_alignment_and_odometry(demo_folder: Path, tmp_path: Path, ask: Ask) -> None:
    results = tmp_path / "results"
    shutil.copytree(demo_folder / "results", results)
    before = json.loads((results / "evaluation.json").read_text())
    (results / "evaluation.json").unlink()
    text = ask("evaluate", results)
    header, *lines = text.splitlines()
    assert header.split() == ["measure", "run", "unit", "odometry", "ratio"]
    row = next(line for line in lines if line.startswith("ATE RMSE, SE(3)-aligned, scale off"))
    run_m, unit, odometry_m, ratio = row.split("scale off")[1].split()
    assert unit == "m" and float(ratio) == pytest.approx(float(run_m) / float(odometry_m), abs=0.01)
    after = json.loads((results / "evaluation.json").read_text())
    assert after["notes"] == before["notes"]
    assert after["rows"][: len(before["rows"])] == before["rows"], "asfm run writes the same rows, without the bound"
    table = evaluate_folder(results)
    assert table.row("ate_rmse_m_se3").value == pytest.approx(float(run_m), abs=5e-5)


def test_evaluation_of_a_simulated_run_states_its_bound(
    demo_folder: Path, tmp_path: Path, ask: Ask, capsys: Any
) -> None:
    results = tmp_path / "results"
    shutil.copytree(demo_folder / "results", results)
    text = ask("evaluate", results)
    bound_m, ate_over_bound = (
        float(next(line for line in text.splitlines() if line.startswith(name)).split("scale off")[1].split()[0])
        for name in ("bound (true associations, ideal points), SE(3)-aligned", "ATE / bound, SE(3)-aligned")
    )
    ate_m = evaluate_folder(results).row("ate_rmse_m_se3").value
    assert bound_m > 0 and ate_over_bound == pytest.approx(ate_m / bound_m, rel=0.05)
    found = {row["key"]: row["value"] for row in json.loads((results / "evaluation.json").read_text())["rows"]}
    assert found["ate_over_bound"] == pytest.approx(ate_over_bound, rel=0.01)
    assert 0.1 < found["nees_position"] < 10 and 0.1 < found["nees_attitude"] < 10
    assert found["match_precision_gap_1"] > 0.9 and 0.2 < found["match_recall_gap_1"] < 1
    assert found["match_count_gap_1"] > found["match_count_gap_2"] > 0
    assert found["match_count_overall"] > found["match_count_gap_1"] and found["match_precision_overall"] > 0.9
    assert 0.5 < found["track_purity"] <= 1 and 0 < found["match_coverage"] <= found["keypoint_coverage"] < 1
    assert abs(found["match_range_bias_px_overall"]) < 2 and 0 < found["match_bearing_sigma_px_overall"] < 5
    assert "match precision, all frame pairs" in text and "bias of correct matches" not in text
    assert "more measures" in text and "evaluation.json" in text
    assert 0 <= found["landmarks_well_constrained_share"] <= 1
    assert "bound" not in ask("evaluate", results, "--reference", results / "trajectory.tum")
    header, first, *rows = (results / "tracks.csv").read_text().splitlines()
    cells = first.split(",")
    broken = ",".join([*cells[:6], "yes", *cells[7:]])
    (results / "tracks.csv").write_text("\n".join([header, broken, *rows]))
    assert run_command_line(["evaluate", str(results)]) == 2
    message = capsys.readouterr().err
    assert "tracks.csv, line " in message and "as used, found 'yes'" in message and message.count("\n") == 1
    (results / "tracks.csv").unlink()
    text = ask("evaluate", results)
    assert "note: The results hold no tracks.csv" in text and "ATE / bound" not in text


def test_points_of_another_run_are_refused(demo_folder: Path, tmp_path: Path, capsys: Any) -> None:
    results = tmp_path / "results"
    shutil.copytree(demo_folder / "results", results)
    header, *rows = (results / "tracks.csv").read_text().splitlines()
    without = [row if row.endswith(",") else row[: row.rindex(",") + 1] for row in rows[: len(rows) // 2]]
    (results / "tracks.csv").write_text("\n".join([header, *without, *rows[len(rows) // 2 :]]))
    assert run_command_line(["evaluate", str(results)]) == 2
    message = capsys.readouterr().err
    assert "points.ply: expected the points of the tracks" in message and message.count("\n") == 1


def test_reference_replaces_the_truth(demo_folder: Path, tmp_path: Path, ask: Ask, capsys: Any) -> None:
    results = tmp_path / "results"
    ask("run", demo_folder / "seafloor", "--output", results, "--no-rerun")
    by_truth = evaluate_folder(results)
    table = evaluate_folder(results, results / "trajectory.tum")
    assert table.row("ate_rmse_m_se3").value == pytest.approx(0, abs=1e-9)
    assert table.row("match_arc_inlier_ratio_overall").value > 0.8
    assert not [row.key for row in table.rows if "precision" in row.key]
    table = evaluate_folder(results, demo_folder / "seafloor" / "groundtruth.tum")
    for key in ("match_arc_inlier_ratio_overall", "match_arc_inlier_ratio_gap_1", "match_count_gap_2"):
        assert table.row(key).value == pytest.approx(by_truth.row(key).value, abs=1e-6)
    report = json.loads((results / "report.json").read_text())
    report["sequence"]["path"] = str(tmp_path / "gone")
    (results / "report.json").write_text(json.dumps(report))
    assert run_command_line(["evaluate", str(results)]) == 2
    message = capsys.readouterr().err
    assert "gone: expected a sequence" in message and "--reference" in message and message.count("\n") == 1
    text = ask("evaluate", results, "--reference", results / "trajectory.tum")
    assert "note: Without the odometry's row: " in text
    for content, expected in (("{", "cannot read a report"), ("[]", "no sequence in it"), ('{"sequence": {}}', "path")):
        (results / "report.json").write_text(content)
        assert run_command_line(["evaluate", str(results)]) == 2
        assert expected in capsys.readouterr().err
    assert run_command_line(["evaluate", str(tmp_path)]) == 2
    assert "found no report.json in it" in capsys.readouterr().err


def test_a_far_reference_with_a_lost_tracker_is_compared_where_it_is_known(
    demo_folder: Path, tmp_path: Path, ask: Ask, capsys: Any
) -> None:
    """The trajectory of the run itself, in UTM: its error is zero, and a note says what was left out."""
    results, reference = tmp_path / "results", tmp_path / "utm.tum"
    shutil.copytree(demo_folder / "results", results)
    poses = read_tum(results / "trajectory.tum")
    rows = tum_from_pose(shift_trajectory(poses, np.array([5e5, 5.572e6, 40.0])).world_from_vehicle)
    rows[4:] = np.nan
    columns = np.column_stack([poses.timestamps_s, rows])
    np.savetxt(reference, columns, fmt="%.9f")
    text = ask("evaluate", results, "--reference", reference)
    assert f"{len(rows) - 4} of {len(rows)} poses of the reference" in text and "are not finite: left out" in text
    assert f"4 of {len(rows)} poses have a reference within reach" in text
    assert evaluate_folder(results, reference).row("ate_rmse_m_se3").value < 1e-6
    columns[:, 0] *= 1e9
    np.savetxt(reference, columns, fmt="%.9f")
    assert run_command_line(["evaluate", str(results), "--reference", str(reference)]) == 2
    message = capsys.readouterr().err
    assert "nanoseconds" in message and message.count("\n") == 1


def test_a_trajectory_of_other_frames_is_refused(demo_folder: Path, tmp_path: Path, capsys: Any) -> None:
    results = tmp_path / "results"
    shutil.copytree(demo_folder / "results", results)
    path = results / "trajectory.tum"
    header, *rows = path.read_text().splitlines()
    path.write_text("\n".join([header, *rows[:-1]]))
    assert run_command_line(["evaluate", str(results)]) == 2
    message = capsys.readouterr().err
    assert "trajectory.tum: expected a pose for each of the 6 frames of the sequence, found 5" in message
    stamp, pose = rows[-1].split(" ", 1)
    path.write_text("\n".join([header, *rows[:-1], f"{float(stamp) + 0.01} {pose}"]))
    assert run_command_line(["evaluate", str(results)]) == 2
    message = capsys.readouterr().err
    assert "of frame 5 of the sequence, found" in message and message.count("\n") == 1


def test_a_link_that_leads_nowhere_is_no_missing_file(demo_folder: Path, tmp_path: Path, capsys: Any) -> None:
    results = tmp_path / "results"
    shutil.copytree(demo_folder / "results", results)
    (results / "matches.h5").unlink()
    (results / "matches.h5").symlink_to("gone")
    assert run_command_line(["evaluate", str(results)]) == 2
    message = capsys.readouterr().err
    assert "matches.h5: expected " in message and "a link to 'gone', which is missing" in message


def test_without_true_poses_a_note_names_what_is_left_out(demo_folder: Path, tmp_path: Path, ask: Ask) -> None:
    """Points tracked by hand are all there is to compare with."""
    sequence, results = tmp_path / "seafloor", tmp_path / "results"
    shutil.copytree(demo_folder / "seafloor", sequence)
    shutil.copytree(demo_folder / "results", results)
    stamps_s = read_tum(sequence / "groundtruth.tum").timestamps_s[:4]
    (sequence / "groundtruth.tum").unlink()
    shutil.rmtree(sequence / "truth")
    rows = [f"{stamp},0,3.0,0.1" for stamp in stamps_s]
    (sequence / "landmarks.csv").write_text("\n".join(["timestamp_s,landmark,range_m,bearing_rad", *rows]))
    report = json.loads((results / "report.json").read_text())
    report["sequence"]["path"] = str(sequence)
    (results / "report.json").write_text(json.dumps(report))
    text = ask("evaluate", results)
    assert "range RMSE of hand-tracked points" in text and "match" not in text.split("note: ")[0]
    assert "note: Matcher quality is without arc inlier ratio, precision, recall" in text
