"""Images with faulty navigation from end to end: a warning with numbers, finite poses, and hardly a loss."""

from dataclasses import replace

import numpy as np
import pytest

from asfm.config import Config
from asfm.evaluation.trajectory import align_se3
from asfm.geometry.poses import chain_steps, invert
from asfm.pipeline.reconstruction import reconstruct
from asfm.sequence import Sequence
from asfm.simulation.simulate import simulate
from asfm.types import FloatArray, Reconstruction

FRAMES = 16


@pytest.fixture(scope="module")
def tank() -> Sequence:
    """A sway before a tank's targets, its frames in memory."""
    sequence = simulate("tank", frame_count=FRAMES, seed=1).sequence
    return replace(sequence, read_frame=list(sequence).__getitem__)


@pytest.fixture(scope="module")
def clean(tank: Sequence) -> Reconstruction:
    return reconstruct(tank, Config()).reconstruction


def _error_m(found: Reconstruction, tank: Sequence) -> float:
    """Root mean square distance from the truth after alignment."""
    assert tank.groundtruth is not None
    poses, truth = found.trajectory.world_from_vehicle, tank.groundtruth.world_from_vehicle
    assert np.isfinite(poses).all() and np.isfinite(found.landmarks.xyz_m).all()
    off_m = (align_se3(poses, truth) @ poses - truth)[:, :3, 3]
    return float(np.sqrt(np.mean(np.sum(off_m**2, axis=1))))


def _with_odometry(sequence: Sequence, poses: FloatArray) -> Sequence:
    assert sequence.odometry is not None
    return replace(sequence, odometry=replace(sequence.odometry, world_from_vehicle=poses))


def test_clean_navigation_has_no_warning(tank: Sequence, clean: Reconstruction) -> None:
    assert clean.diagnostics == ()
    assert _error_m(clean, tank) < 0.03


def test_a_jump_wrong_readings_and_a_repeated_frame_at_once(tank: Sequence, clean: Reconstruction) -> None:
    assert tank.odometry is not None and tank.navigation is not None
    poses = tank.odometry.world_from_vehicle
    steps = invert(poses[:-1]) @ poses[1:]
    steps[12, :3, 3] += [0.8, -0.6, 0.0]
    z_m, roll_rad = tank.navigation.z_m.copy(), tank.navigation.roll_rad.copy()
    z_m[8] += 1.0
    roll_rad[14] += 0.35
    frames = list(tank)
    frames[7] = replace(frames[7], image=frames[6].image)
    faulty = replace(
        _with_odometry(tank, chain_steps(poses[0], steps)),
        navigation=replace(tank.navigation, z_m=z_m, roll_rad=roll_rad),
        read_frame=frames.__getitem__,
    )
    found = reconstruct(faulty, Config()).reconstruction
    for code, numbers in (
        ("odometry-jump", "by 1 m"),
        ("odometry-jump", "between frames 12 and 13"),
        ("navigation-outliers", f"1 of {FRAMES} depth readings"),
        ("navigation-outliers", f"1 of {FRAMES} roll readings"),
        ("duplicate-frames", f"1 of {FRAMES} frames (7)"),
    ):
        assert any(item.code == code and numbers in item.message for item in found.diagnostics), (code, numbers)
    assert _error_m(found, tank) < 1.3 * _error_m(clean, tank) + 0.003


def test_mirrored_odometry_costs_little(tank: Sequence, clean: Reconstruction) -> None:
    assert tank.odometry is not None
    poses = tank.odometry.world_from_vehicle.copy()
    poses[:, 1, 3] *= -1
    found = reconstruct(_with_odometry(tank, poses), Config()).reconstruction
    (conflict,) = found.diagnostics
    assert conflict.code == "odometry-image-conflict" and "y axis mirrored" in conflict.message
    assert _error_m(found, tank) < 1.5 * _error_m(clean, tank) + 0.003
