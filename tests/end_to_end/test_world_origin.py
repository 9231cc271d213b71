"""Results do not depend on the origin and the heading of the world, whatever sensors there are."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.config import Config
from asfm.geometry.poses import make_pose
from asfm.pipeline.reconstruction import reconstruct
from asfm.recorder import NullRecorder
from asfm.sequence import Sequence
from asfm.simulation.simulate import simulate
from asfm.types import FloatArray, Reconstruction, Trajectory

FRAMES = 6
MAX_SHIFT_M, MAX_TURN_RAD = 1e-6, 1e-8
SENSORS = {"odometry, depth and attitude": (True, True), "odometry": (True, False), "depth and attitude": (False, True)}
UTM = (np.array([500000.0, 5572094.155, 0.0]), 0.0)
RNG = np.random.default_rng(12)
WORLDS = [UTM, (RNG.uniform(-6e6, 6e6, 3), RNG.uniform(-3, 3))]


@pytest.fixture(scope="module")
def tank() -> Sequence:
    sequence = simulate("tank", frame_count=FRAMES, seed=4).sequence
    frames = list(sequence)
    return replace(sequence, read_frame=frames.__getitem__)


def reconstruct_with(sequence: Sequence, sensors: str, recorder: NullRecorder | None = None) -> Reconstruction:
    use_odometry, use_navigation = SENSORS[sensors]
    backend = {"use_odometry": use_odometry, "use_navigation": use_navigation, "rounds": 2}
    return reconstruct(sequence, Config.model_validate({"backend": backend}), recorder).reconstruction


@pytest.fixture(scope="module")
def expected(tank: Sequence) -> dict[str, Reconstruction]:
    return {sensors: reconstruct_with(tank, sensors) for sensors in SENSORS}


def move_world(sequence: Sequence, offset_m: FloatArray, yaw_rad: float) -> Sequence:
    """Turn and shift odometry, depth and true poses."""
    moved = make_pose(offset_m, Rotation.from_euler("z", yaw_rad))
    odometry, truth, navigation = sequence.odometry, sequence.groundtruth, sequence.navigation
    assert odometry is not None and truth is not None and navigation is not None
    return replace(
        sequence,
        odometry=Trajectory(odometry.timestamps_s, moved @ odometry.world_from_vehicle),
        groundtruth=Trajectory(truth.timestamps_s, moved @ truth.world_from_vehicle),
        navigation=replace(navigation, z_m=navigation.z_m + offset_m[2]),
    )


@pytest.mark.parametrize("world", range(len(WORLDS)))
@pytest.mark.parametrize("sensors", SENSORS)
def test_offset_and_yaw_of_the_world_change_nothing(
    tank: Sequence, expected: dict[str, Reconstruction], sensors: str, world: int
) -> None:
    """Without odometry the world is the run's own, but for the height: only that follows."""
    offset_m, yaw_rad = WORLDS[world]
    found, reference = reconstruct_with(move_world(tank, offset_m, yaw_rad), sensors), expected[sensors]
    if sensors == "depth and attitude":
        offset_m, yaw_rad = offset_m * [0, 0, 1], 0.0
    assert len(found.landmarks) == len(reference.landmarks) > 20
    turn = Rotation.from_euler("z", yaw_rad)
    poses, true_poses = found.trajectory.world_from_vehicle, reference.trajectory.world_from_vehicle
    for xyz_m, true_m in (
        (poses[:, :3, 3], true_poses[:, :3, 3]),
        (found.landmarks.xyz_m, reference.landmarks.xyz_m),
        (found.landmarks.arc_m.reshape(-1, 3), reference.landmarks.arc_m.reshape(-1, 3)),
    ):
        np.testing.assert_allclose(turn.inv().apply(xyz_m - offset_m), true_m, rtol=0, atol=MAX_SHIFT_M)
    between = Rotation.from_matrix(true_poses[:, :3, :3]).inv() * turn.inv() * Rotation.from_matrix(poses[:, :3, :3])
    assert between.magnitude().max() < MAX_TURN_RAD
    np.testing.assert_allclose(found.pose_covariance, reference.pose_covariance, rtol=1e-4, atol=1e-12)
    assert [item.code for item in found.diagnostics] == [item.code for item in reference.diagnostics]


def test_a_recorder_gets_the_recorded_world(tank: Sequence) -> None:
    """Sequence and result that are recorded are in the world of the odometry, not about the local origin."""
    given: list[Any] = []

    class Recorder(NullRecorder):
        def record_reconstruction(self, *result: Any, **_: object) -> None:
            given.append(result)

    moved = move_world(tank, *UTM)
    result = reconstruct_with(moved, "odometry", Recorder())
    ((sequence, reconstruction),) = given
    assert sequence.odometry is moved.odometry and sequence.groundtruth is moved.groundtruth
    assert sequence.navigation is moved.navigation
    assert reconstruction.trajectory is result.trajectory
    assert moved.odometry is not None
    first_m = result.trajectory.world_from_vehicle[0, :3, 3]
    np.testing.assert_allclose(first_m, moved.odometry.world_from_vehicle[0, :3, 3], atol=0.1)
