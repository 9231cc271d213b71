"""Pose error of the mirror image: zero for a reflected truth, in place beside that of the run itself."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.diagnostics import CODES
from asfm.evaluation.evaluation_table import EvaluationTable
from asfm.evaluation.mirror_image import ATE_RMSE_MIRRORED, MIRROR_AMBIGUITY, add_mirror_image
from asfm.evaluation.pose_error_table import ATE_RMSE, evaluate_sequence
from asfm.geometry.poses import invert, make_pose
from asfm.sequence import Sequence
from asfm.types import Trajectory
from tests.worlds import make_vehicle_path, make_vehicle_sequence

LEVER_ARM = make_pose(np.array([0.4, -0.2, 0.3]), Rotation.from_euler("ZYX", [0.2, 0.5, -0.1]))
REFLECTION = np.diag([1.0, 1.0, -1.0, 1.0])


def make_sequence() -> Sequence:
    sequence = make_vehicle_sequence()
    truth = Trajectory(sequence.timestamps_s, make_vehicle_path())
    return replace(sequence, vehicle_from_sonar=LEVER_ARM, groundtruth=truth)


def mirror(trajectory: Trajectory) -> Trajectory:
    """Reflect the sonar's poses at the first one's x-y plane, and carry the vehicle along."""
    sonar = trajectory.world_from_vehicle @ LEVER_ARM
    mirrored = sonar[0] @ REFLECTION @ invert(sonar[0]) @ sonar @ REFLECTION
    return replace(trajectory, world_from_vehicle=mirrored @ invert(LEVER_ARM))


def test_a_mirrored_truth_has_an_error_and_its_mirror_image_has_none() -> None:
    sequence = make_sequence()
    assert sequence.groundtruth is not None
    estimate = mirror(sequence.groundtruth)
    table = add_mirror_image(evaluate_sequence(sequence, estimate), sequence, estimate)
    assert table.row(ATE_RMSE).value > 0.01
    assert table.row(ATE_RMSE_MIRRORED).value < 1e-9
    keys = [row.key for row in table.rows]
    assert keys[keys.index(ATE_RMSE) + 1] == ATE_RMSE_MIRRORED and table.row(ATE_RMSE_MIRRORED).odometry is None


@pytest.mark.parametrize("given", [False, True])
def test_a_true_estimate_has_the_error_in_its_mirror_image_whatever_gives_the_truth(given: bool) -> None:
    sequence = make_sequence()
    truth = sequence.groundtruth
    assert truth is not None
    other = replace(sequence, groundtruth=None) if given else sequence
    table = add_mirror_image(evaluate_sequence(sequence, truth), other, truth, truth if given else None)
    assert table.row(ATE_RMSE).value < 1e-9
    expected = evaluate_sequence(sequence, mirror(truth)).row(ATE_RMSE).value
    assert table.row(ATE_RMSE_MIRRORED).value == pytest.approx(expected)


def test_without_true_poses_the_table_is_unchanged() -> None:
    sequence = replace(make_sequence(), groundtruth=None)
    table = EvaluationTable(())
    assert add_mirror_image(table, sequence, Trajectory(np.zeros(1), np.eye(4)[None])) is table


def test_the_code_is_that_of_a_diagnostic() -> None:
    assert MIRROR_AMBIGUITY in CODES
