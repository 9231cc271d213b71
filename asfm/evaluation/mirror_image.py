"""Pose error of the mirror image of a run: what the sonar alone cannot tell from the run itself."""

from dataclasses import replace

from asfm.evaluation.evaluation_table import EvaluationRow, EvaluationTable
from asfm.evaluation.pose_error_table import ATE_RMSE, SE3_ALIGNED, evaluate_trajectory
from asfm.geometry.reflection import reflect_after
from asfm.sequence import Sequence
from asfm.types import Trajectory

MIRROR_AMBIGUITY = "mirror-ambiguity"
"""Code of the diagnostic of a run that does not tell itself from its mirror image."""
ATE_RMSE_MIRRORED = "ate_rmse_m_se3_mirror_image"
"""Key of the absolute trajectory error of the mirror image, RMSE after SE(3) alignment."""


def add_mirror_image(
    table: EvaluationTable, sequence: Sequence, estimate: Trajectory, reference: Trajectory | None = None
) -> EvaluationTable:
    """Add the error of the estimate reflected at the x-y plane of its first sonar frame.

    The sonar measures the same ranges and bearings in both. The nearer of the two errors is that of the method, the
    other one that of the choice between them.

    Args:
        table: of the estimate itself; it is returned unchanged where there are no true poses.
        sequence: gives the lever arm and, without a reference, the true poses.
        estimate: world_from_vehicle.
        reference: true world_from_vehicle in place of the sequence's own.

    Raises:
        AsfmError: fewer than two poses of the estimate have a true pose within reach.
    """
    truth = reference if reference is not None else sequence.groundtruth
    if truth is None:
        return table
    mirrored = reflect_after(estimate.world_from_vehicle, 0, sequence.vehicle_from_sonar)
    error = evaluate_trajectory(truth, None, replace(estimate, world_from_vehicle=mirrored)).row(ATE_RMSE).value
    row = EvaluationRow(ATE_RMSE_MIRRORED, f"ATE RMSE of the mirror image, {SE3_ALIGNED}", error, "m")
    keys = [other.key for other in table.rows]
    place = keys.index(ATE_RMSE) + 1
    return EvaluationTable((*table.rows[:place], row, *table.rows[place:]), table.notes)
