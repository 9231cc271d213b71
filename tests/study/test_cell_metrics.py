"""Metrics of a cell: mirror images of a sonar alone, and metrics that a sequence's truth does not allow."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from asfm.config import Config
from asfm.errors import AsfmError
from asfm.evaluation.matcher_quality import measure_matcher
from asfm.geometry.reflection import reflect_after
from asfm.pipeline import Run
from asfm.sequence import Sequence
from asfm.simulation.simulate import SimulatedSequence, simulate
from asfm.study.cell import Cell, Simulation
from asfm.study.cell_metrics import describe_failure, measure_cell
from asfm.study.results_table import GAP_METRICS, GAPS, gap_column
from asfm.study.sequence_provider import StudySequence
from asfm.types import FloatArray, Keypoints, Landmarks, Matches, Reconstruction, Tracks, Trajectory
from tests.worlds import make_keypoints

FRAMES = 5
CELL = Cell(Simulation("tank", "didson", None, 0, FRAMES), 0, "sonar", "akaze", "default", "default", Config(), 0)


@pytest.fixture(scope="module")
def tank() -> SimulatedSequence:
    return simulate("tank", "didson", FRAMES)


def make_run(poses: FloatArray, sequence: Sequence, keypoints: list[Keypoints], matches: list[Matches]) -> Run:
    nothing = np.zeros(0, dtype=np.int64)
    tracks = Tracks(np.array([0, 0, 0]), np.array([0, 1, 2]), np.full(3, 3.0), np.zeros(3))
    points = np.zeros((0, 3))
    landmarks = Landmarks(
        nothing, points, np.zeros((0, 3, 3)), np.zeros(0), nothing, nothing.astype(bool), np.zeros((0, 2, 3))
    )
    trajectory, used = Trajectory(sequence.timestamps_s, poses), np.ones(3, dtype=bool)
    reconstruction = Reconstruction(trajectory, tracks, used, landmarks, np.zeros((FRAMES, 6, 6)), ())
    return Run(reconstruction, (), tuple(keypoints), tuple(matches))


def open_sequence(tank: SimulatedSequence, with_truth: bool = True) -> StudySequence:
    read_truth = tank.read_truth if with_truth else None
    return StudySequence(Path("x"), tank.sequence, np.arange(FRAMES), tank.sequence, read_truth)


def observe(tank: SimulatedSequence) -> tuple[list[Keypoints], list[Matches]]:
    """Take keypoints at pixels with an echo; each is matched with the same place one frame later."""
    keypoints = []
    for frame in range(FRAMES):
        row, column = (index[::50] for index in np.nonzero(np.isfinite(tank.read_truth(frame).elevation_rad)))
        sonar = tank.sequence.sonar
        keypoints.append(make_keypoints(sonar.range_m[row][:40], sonar.bearing_rad[column][:40]))
        pixels = np.stack([row, column], axis=1)[:40].astype(np.float64) + np.float64(0.5)
        keypoints[-1] = replace(keypoints[-1], row_column=pixels)
    index = np.stack([np.arange(40), np.arange(40)], axis=1)
    return keypoints, [Matches(a, a + 1, index, np.zeros(40)) for a in range(FRAMES - 1)]


def test_the_sonar_alone_is_measured_by_the_nearer_mirror_image(tank: SimulatedSequence) -> None:
    truth = tank.sequence.groundtruth
    assert truth is not None
    mirrored = reflect_after(truth.world_from_vehicle, 0, tank.sequence.vehicle_from_sonar)
    run = make_run(mirrored, tank.sequence, *observe(tank))
    alone = measure_cell(CELL, run, open_sequence(tank), None)
    assert alone["mirror_aware"] and alone["ate_m"] == pytest.approx(0, abs=1e-9) and alone["ate_as_it_is_m"] > 1e-6
    right = measure_cell(
        CELL, make_run(truth.world_from_vehicle, tank.sequence, *observe(tank)), open_sequence(tank), None
    )
    for name in ("rotation_rmse_deg", "rpe_translation_m", "ate_over_path_percent"):
        assert alone[name] == pytest.approx(right[name], abs=1e-6), "all of them are those of the nearer image"
    others = measure_cell(replace(CELL, mode="all"), run, open_sequence(tank), None)
    assert not others["mirror_aware"] and others["ate_m"] == others["ate_as_it_is_m"] == alone["ate_as_it_is_m"]
    assert others["ate_over_odometry"] == pytest.approx(others["ate_m"] / others["odometry_ate_m"])
    assert others["stationary_ate_m"] > 0 and others["track_length"] == 3 and others["keypoints_per_frame"] == 40


def test_matches_are_measured_by_what_truth_there_is(tank: SimulatedSequence) -> None:
    truth = tank.sequence.groundtruth
    assert truth is not None
    run = make_run(truth.world_from_vehicle, tank.sequence, *observe(tank))
    full = measure_cell(CELL, run, open_sequence(tank), None)
    assert full["matches"] == 160 and 0 <= full["precision"] <= 1 and 0 <= full["arc_inlier_ratio"] <= 1
    assert 0 < full["match_coverage"] <= full["keypoint_coverage"] < 1 and full["track_purity"] is not None
    quality = measure_matcher(run.keypoints, run.matches, run.reconstruction.tracks, tank.sequence, tank.read_truth)
    assert quality.error is not None and full["range_bias_m"] == quality.error.range_bias_m
    np.testing.assert_allclose(full["range_noise_bins"], quality.error.range_sigma_px / np.sqrt(2))
    np.testing.assert_allclose(full["bearing_noise_beams"], quality.error.bearing_sigma_px / np.sqrt(2))
    for gap in GAPS:
        for name in GAP_METRICS:
            expected = full[name] if gap == 1 else None  # all are matched with the next frame
            assert full.get(gap_column(name, gap)) == expected
    assert "bound_ate_m" not in full and full["missing"] == "no draws of the noise: bound"
    poses_only = measure_cell(CELL, run, open_sequence(tank, with_truth=False), None)
    assert "precision" not in poses_only and poses_only["arc_inlier_ratio"] == full["arc_inlier_ratio"]
    assert "precision_gap_1" not in poses_only
    assert poses_only["arc_inlier_ratio_gap_1"] == full["arc_inlier_ratio"]
    assert poses_only["missing"] == "no true elevations: precision, recall, noise, purity and bound"
    opened = open_sequence(tank, with_truth=False)
    bare = replace(opened, sequence=replace(opened.sequence, groundtruth=None))
    nothing = measure_cell(CELL, run, bare, None)
    assert "ate_m" not in nothing and nothing["missing"] == "no true poses: pose errors, precision and recall"
    assert nothing["matches"] == 160


def test_bad_input_is_told_from_defects() -> None:
    assert describe_failure(AsfmError("no frames")) == "no frames"
    assert describe_failure(KeyError("x\ny")) == "defect, KeyError: 'x\\ny'"
