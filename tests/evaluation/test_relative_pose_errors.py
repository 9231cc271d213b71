"""Relative pose errors as rows, against evo (a test-time oracle only)."""

import numpy as np
import pytest
from evo.core import metrics
from evo.core.trajectory import PosePath3D

from asfm.evaluation.association import PosePairs
from asfm.evaluation.relative_pose_errors import list_relative_errors
from asfm.types import FloatArray
from tests.evaluation.test_trajectory import disturb, random_walk


def pairs_of(estimate: FloatArray, reference: FloatArray) -> PosePairs:
    return PosePairs(0.2 * np.arange(float(len(estimate))), estimate, reference)


def even_path(count: int = 41, step_m: float = 0.1) -> FloatArray:
    """Return poses of random orientation at even steps on a circle: every length has pairs without remainder."""
    poses = random_walk(3, count)
    angle = np.arange(count) * 0.05
    poses[:, :3, 3] = 10 * step_m / 0.5 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    return poses


def evo_rmse(pairs: PosePairs, relation: metrics.PoseRelation, percent: float) -> float:
    """Return evo's RPE over a percentage of the path, every pose being the first of a pair."""
    reference = PosePath3D(poses_se3=list(pairs.reference))
    metric = metrics.RPE(
        relation,
        delta=percent / 100 * reference.path_length,
        delta_unit=metrics.Unit.meters,
        rel_delta_tol=1e-6,
        all_pairs=True,
        pairs_from_reference=True,
    )
    metric.process_data((reference, PosePath3D(poses_se3=list(pairs.estimate))))
    return float(metric.get_statistic(metrics.StatisticsType.rmse))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("percent", "suffix"),
    [(5, "5_percent_of_path"), (10, "segment"), (20, "20_percent_of_path"), (50, "50_percent_of_path")],
)
def test_errors_over_lengths_agree_with_evo(percent: int, suffix: str, seed: int) -> None:
    reference = even_path()
    pairs = pairs_of(disturb(reference, seed), reference)
    value = {row.key: row.value for row in list_relative_errors(pairs)}
    translation_m = evo_rmse(pairs, metrics.PoseRelation.translation_part, percent)
    rotation_deg = evo_rmse(pairs, metrics.PoseRelation.rotation_angle_deg, percent)
    assert value[f"rpe_translation_rmse_m_{suffix}"] == pytest.approx(translation_m, abs=1e-6)
    assert value[f"rpe_rotation_rmse_deg_{suffix}"] == pytest.approx(rotation_deg, abs=1e-6)


def test_a_drift_grows_with_the_length() -> None:
    reference = random_walk(0, 200)
    estimate = reference.copy()
    estimate[:, :3, 3] *= 1.1
    value = {row.key: row.value for row in list_relative_errors(pairs_of(estimate, reference))}
    keys = ("5_percent_of_path", "segment", "20_percent_of_path")
    errors = [value[f"rpe_translation_rmse_m_{key}"] for key in keys]
    assert errors == sorted(errors) and errors[0] > value["rpe_translation_rmse_m_frame"] > 0


def test_a_static_path_has_the_errors_of_one_frame_alone() -> None:
    static = np.tile(np.eye(4), (3, 1, 1))
    keys = [row.key for row in list_relative_errors(pairs_of(static, static))]
    assert keys == ["rpe_translation_rmse_m_frame", "rpe_rotation_rmse_deg_frame"]
