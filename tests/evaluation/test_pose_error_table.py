"""Table of pose errors: its values, the odometry's beside them, its keys, and JSON."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from evo.core import metrics
from evo.core.trajectory import PosePath3D
from scipy.spatial.transform import Rotation

from asfm.datasets import open_sequence
from asfm.errors import AsfmError
from asfm.evaluation.evaluation_table import EvaluationTable
from asfm.evaluation.pose_error_table import ATE_OVER_PATH, ATE_RMSE, evaluate_sequence, evaluate_trajectory
from asfm.geometry.poses import make_pose
from asfm.geometry.sonar import SonarModel
from asfm.sequence import Sequence
from asfm.types import Frame, HandTracks, Trajectory

FIRST_POSE_ATE = "ate_rmse_m_first_pose"
FRAME_RPE = "rpe_translation_rmse_m_frame"


def walk(seed: int = 0, count: int = 30, sigma_m: float = 0.0) -> Trajectory:
    """Make a fixed path with noise on every pose, 0.1 rad of rotation for each metre of translation."""
    path = np.random.default_rng(99)
    positions_m = np.cumsum(path.normal(scale=0.2, size=(count, 3)), axis=0)
    rotations = Rotation.random(count, path)
    noise = np.random.default_rng(seed).normal(scale=sigma_m, size=(2, count, 3))
    turned = rotations * Rotation.from_rotvec(0.1 * noise[1])
    return Trajectory(0.2 * np.arange(float(count)), make_pose(positions_m + noise[0], turned))


def no_image(index: int) -> Frame:
    raise AssertionError(f"the table needs no image, frame {index} was requested")


def sequence_with(
    odometry: Trajectory | None, groundtruth: Trajectory | None, hand_tracks: HandTracks | None = None
) -> Sequence:
    return Sequence(
        name="made up",
        sonar=SonarModel.evenly_spaced("test", (0.3, 6.0), (-0.7, 0.7), (500, 256), 0.35),
        timestamps_s=walk().timestamps_s,
        read_frame=no_image,
        odometry=odometry,
        groundtruth=groundtruth,
        hand_tracks=hand_tracks,
    )


def assert_json_holds(table: EvaluationTable) -> None:
    back = json.loads(json.dumps(table.as_dict(), allow_nan=False))
    assert [(row["key"], row["name"]) for row in back["rows"]] == [(row.key, row.name) for row in table.rows]
    assert len({row.name for row in table.rows}) == len({row.key for row in table.rows}) == len(table.rows)
    assert all(re.fullmatch("[a-z][a-z0-9_]*", row.key) for row in table.rows)
    assert all(table.row(row.key) is row for row in table.rows)
    assert all(math.isfinite(row["value"]) for row in back["rows"])


def test_ratio_is_the_estimate_over_the_odometry() -> None:
    table = evaluate_trajectory(walk(), walk(1, sigma_m=0.4), walk(2, sigma_m=0.1))
    assert_json_holds(table)
    assert table.notes == ()
    for row in table.rows[3:]:
        assert row.odometry is not None
        if row.unit == "":
            assert row.ratio is None, "more poses within a threshold are better"
            continue
        assert row.ratio is not None
        assert row.ratio == pytest.approx(row.value / row.odometry)
    ratio = table.row(ATE_RMSE).ratio
    assert ratio is not None
    assert 0.15 < ratio < 0.4


def test_every_pose_error_states_alignment_and_scale() -> None:
    table = evaluate_trajectory(walk(), walk(1, sigma_m=0.4), walk(2, sigma_m=0.1))
    for row in table.rows:
        if row.key.startswith(("ate_", "rotation_")):
            alignments = {
                "_se3": "SE(3)-aligned, scale off",
                "_first_pose": "first pose aligned, scale off",
                "_aligned": "rotations aligned by themselves",
            }
            assert [name for suffix, name in alignments.items() if row.key.endswith(suffix) and name in row.name]
        if row.key.startswith("rpe_"):
            assert "scale off" in row.name
        assert {"m": "_m", "deg": "_deg", "%": "_percent", "poses": "poses_", "": "pose"}[row.unit] in row.key


def test_keys_are_stable() -> None:
    """Programs read these from evaluation.json."""
    table = evaluate_trajectory(walk(), None, walk(2, sigma_m=0.1))
    absolute = ["ate_rmse_m", "ate_mean_m", "ate_median_m", "ate_max_m", "ate_over_path_percent", "rotation_rmse_deg"]
    expected = ["poses_compared", "reference_path_m", "stationary_ate_rmse_m"]
    expected += [*(f"{key}_se3" for key in absolute[:-1]), "rotation_rmse_deg_aligned"]
    expected += [f"{key}_first_pose" for key in absolute]
    expected += ["rpe_translation_rmse_m_frame", "rpe_rotation_rmse_deg_frame"]
    for length in ("segment", *(f"{percent}_percent_of_path" for percent in (5, 20, 50))):
        expected += [f"rpe_translation_rmse_m_{length}", f"rpe_rotation_rmse_deg_{length}"]
    for measure in ("poses_within", "pose_auc"):
        expected += [f"{measure}_{at}_percent_{at}_deg" for at in (1, 2, 5, 10)]
    expected += [f"poses_position_within_{at}_percent" for at in (1, 2, 5, 10)]
    expected += [f"poses_rotation_within_{at}_deg" for at in (1, 2, 5, 10)]
    assert [row.key for row in table.rows] == expected


def test_rotations_do_not_depend_on_a_path_that_is_nearly_a_line() -> None:
    """Noise across the line turns the alignment of the positions about it, but not the vehicle."""
    truth = walk(count=60)
    line = truth.world_from_vehicle.copy()
    line[:, :3, 3] = np.outer(np.linspace(0, 1, 60), [1.0, 0.0, 0.0])
    line[:, 1:3, 3] += 1e-3 * np.random.default_rng(0).normal(size=(60, 2))
    shaken = line.copy()
    shaken[:, 1:3, 3] += 1e-2 * np.random.default_rng(1).normal(size=(60, 2))
    table = evaluate_trajectory(
        replace(truth, world_from_vehicle=line), None, replace(truth, world_from_vehicle=shaken)
    )
    assert table.row("rotation_rmse_deg_aligned").value < 1e-4


def test_shares_of_poses_are_those_of_the_aligned_errors() -> None:
    """Half of the rotations are off by 3 degrees to either side; the positions are exact."""
    truth = walk(count=40)
    tilted = truth.world_from_vehicle.copy()
    angle_rad = np.radians(np.tile([0.0, 0.0, 3.0, -3.0], 10))
    off = Rotation.from_rotvec(angle_rad[:, None] * [0.0, 0.0, 1.0])
    tilted[:, :3, :3] = tilted[:, :3, :3] @ off.as_matrix()
    table = evaluate_trajectory(truth, None, replace(truth, world_from_vehicle=tilted))
    assert table.row("poses_within_1_percent_1_deg").value == pytest.approx(0.5)
    assert table.row("poses_within_5_percent_5_deg").value == 1.0
    assert table.row("pose_auc_10_percent_10_deg").value == pytest.approx(0.85, abs=0.02)
    assert table.row("poses_position_within_1_percent").value == 1.0
    assert table.row("poses_rotation_within_2_deg").value == pytest.approx(0.5)


@pytest.mark.parametrize("seed", range(3))
def test_absolute_and_relative_errors_are_those_of_evo(seed: int) -> None:
    """evo is an oracle of the tests only."""
    truth, estimate = walk(), walk(seed, sigma_m=0.2)
    value = {row.key: row.value for row in evaluate_trajectory(truth, None, estimate).rows}
    translation, rotation = metrics.PoseRelation.translation_part, metrics.PoseRelation.rotation_angle_deg
    step: dict[str, Any] = {"delta": 1, "delta_unit": metrics.Unit.frames, "all_pairs": True}
    for key, metric, align in (
        ("ate_rmse_m_se3", metrics.APE(translation), "align"),
        ("ate_rmse_m_first_pose", metrics.APE(translation), "align_origin"),
        ("rotation_rmse_deg_first_pose", metrics.APE(rotation), "align_origin"),
        ("rpe_translation_rmse_m_frame", metrics.RPE(translation, **step), None),
        ("rpe_rotation_rmse_deg_frame", metrics.RPE(rotation, **step), None),
    ):
        reference, aligned = (PosePath3D(poses_se3=list(each.world_from_vehicle)) for each in (truth, estimate))
        if align is not None:
            getattr(aligned, align)(reference)
        metric.process_data((reference, aligned))
        assert value[key] == pytest.approx(metric.get_statistic(metrics.StatisticsType.rmse), abs=1e-6), key


def test_standing_still_scores_the_spread_of_the_path() -> None:
    truth = walk(count=40)
    still = replace(truth, world_from_vehicle=np.repeat(truth.world_from_vehicle[:1], 40, axis=0))
    table = evaluate_trajectory(truth, None, still)
    assert table.row("stationary_ate_rmse_m").value == pytest.approx(table.row(ATE_RMSE).value)


def test_errors_are_the_noise_added() -> None:
    table = evaluate_trajectory(walk(count=500), None, walk(2, count=500, sigma_m=0.1))
    assert table.row(ATE_RMSE).value == pytest.approx(0.1 * math.sqrt(3), rel=0.1)
    assert table.row(FRAME_RPE).value == pytest.approx(0.1 * math.sqrt(6), rel=0.1)
    path_m = table.row("reference_path_m").value
    percent = table.row(ATE_OVER_PATH).value
    assert percent == pytest.approx(100 * table.row(ATE_RMSE).value / path_m)
    assert table.row("poses_compared").value == 500


def test_without_odometry_its_values_are_none() -> None:
    table = evaluate_trajectory(walk(), None, walk(2, sigma_m=0.1))
    assert all(row.odometry is None and row.ratio is None for row in table.rows)


def test_exact_odometry_gives_no_ratio() -> None:
    table = evaluate_trajectory(walk(), walk(), walk(2, sigma_m=0.1))
    assert_json_holds(table)
    assert table.row(ATE_RMSE).ratio is None


def test_odometry_is_evaluated_at_the_stamps_of_the_estimate() -> None:
    truth = walk(count=30)
    half = Trajectory(truth.timestamps_s[::2], truth.world_from_vehicle[::2])
    table = evaluate_trajectory(truth, walk(1, sigma_m=0.4), half)
    noisy = walk(1, sigma_m=0.4)
    expected = evaluate_trajectory(truth, None, Trajectory(noisy.timestamps_s[::2], noisy.world_from_vehicle[::2]))
    assert table.row(ATE_RMSE).odometry == pytest.approx(expected.row(ATE_RMSE).value)


def test_partial_odometry_gives_no_ratio_and_a_note() -> None:
    odometry = walk(1, sigma_m=0.4)
    part = Trajectory(odometry.timestamps_s[:10], odometry.world_from_vehicle[:10])
    table = evaluate_trajectory(walk(), part, walk(2, sigma_m=0.1))
    assert table.row(ATE_RMSE).odometry is not None
    assert table.row(ATE_RMSE).ratio is None
    assert "10 of the 30" in table.notes[0]
    elsewhere = Trajectory(odometry.timestamps_s + 1e3, odometry.world_from_vehicle)
    table = evaluate_trajectory(walk(), elsewhere, walk(2, sigma_m=0.1))
    assert table.row(ATE_RMSE).odometry is None
    assert "0 of the 30" in table.notes[0]


def test_partial_reference_gives_a_note() -> None:
    truth = walk()
    part = Trajectory(truth.timestamps_s[5:15], truth.world_from_vehicle[5:15])
    table = evaluate_trajectory(part, None, walk(2, sigma_m=0.1))
    assert table.row("poses_compared").value == 10
    assert "10 of 30" in table.notes[0]


@pytest.mark.parametrize("count", [2, 5])
def test_a_static_vehicle_has_finite_errors(count: int) -> None:
    rest = Trajectory(np.arange(float(count)), np.tile(np.eye(4), (count, 1, 1)))
    moving = Trajectory(rest.timestamps_s, walk(count=count).world_from_vehicle)
    for estimate in (rest, moving):
        table = evaluate_trajectory(rest, moving, estimate)
        assert_json_holds(table)
        assert not any("%" in row.unit for row in table.rows)


def test_an_unknown_key_is_an_error() -> None:
    with pytest.raises(KeyError, match="no such"):
        evaluate_trajectory(walk(), None, walk()).row("no such")


def test_reference_replaces_the_true_poses() -> None:
    sequence = sequence_with(None, walk(3, sigma_m=1.0))
    assert evaluate_sequence(sequence, walk(), walk()).row(ATE_RMSE).value < 1e-9
    assert evaluate_sequence(sequence, walk()).row(ATE_RMSE).value > 0.5


def test_nothing_to_compare_with_is_an_error() -> None:
    with pytest.raises(AsfmError, match="made up: expected true poses"):
        evaluate_sequence(sequence_with(None, None), walk())


def test_hand_tracked_points_of_the_tank_are_in_the_table(shared_data: Path) -> None:
    sequence = open_sequence(shared_data / "oculus_tank_a")
    assert sequence.groundtruth is not None
    table = evaluate_sequence(sequence, sequence.groundtruth)
    assert_json_holds(table)
    key = "hand_track_range_rmse_m"
    assert table.row(key).value == table.row(f"{key}_true_poses").value < 0.005
    alone = evaluate_sequence(replace(sequence, groundtruth=None), sequence.groundtruth)
    assert [row.unit for row in alone.rows] == ["m", "deg"]
    assert "No true poses" in alone.notes[0]


def test_recorded_odometry_has_ratio_one_to_itself(shared_data: Path) -> None:
    sequence = open_sequence(shared_data / "simulated_seafloor")
    assert sequence.odometry is not None
    table = evaluate_sequence(sequence, sequence.odometry)
    assert_json_holds(table)
    assert all(row.ratio == pytest.approx(1.0) for row in table.rows[3:] if row.unit)
    assert all(row.odometry == row.value for row in table.rows[3:])
    assert table.row(FIRST_POSE_ATE).value > table.row(ATE_RMSE).value
