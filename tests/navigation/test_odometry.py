"""Odometry at the frame times: jumps replaced and reported, gaps with large sigmas, clean odometry unchanged."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.config import BackendConfig
from asfm.geometry.poses import chain_steps, invert, make_pose
from asfm.geometry.sonar import SonarModel
from asfm.navigation.odometry import Odometry, read_odometry
from asfm.sequence import Sequence
from asfm.types import FloatArray, SensorNoise, Trajectory
from tests.worlds import no_frame

SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.7, 0.7), (500, 128), np.deg2rad(20))
COUNT = 40
NOISE = SensorNoise(0.02, 0.005, 0.01, 0.003, 0.003)


def make_steps(seed: int = 0) -> FloatArray:
    rng = np.random.default_rng(seed)
    turn = Rotation.from_rotvec(rng.normal([0, 0, 0.01], 0.005, (COUNT - 1, 3)))
    return make_pose(rng.normal([0.06, 0.01, 0], 0.02, (COUNT - 1, 3)), turn)


def make_sequence(steps: FloatArray) -> Sequence:
    stamps = np.asarray(0.2 * np.arange(COUNT), dtype=np.float64)
    odometry = Trajectory(stamps, chain_steps(np.eye(4), steps))
    return Sequence("simulated", SONAR, stamps, no_frame, odometry=odometry, noise=NOISE)


def read(sequence: Sequence) -> Odometry:
    odometry = read_odometry(sequence, BackendConfig())
    assert odometry is not None
    assert np.isfinite(odometry.world_from_vehicle).all() and (odometry.step_sigma > 0).all()
    return odometry


@pytest.mark.parametrize("seed", range(5))
def test_clean_odometry_is_not_changed(seed: int) -> None:
    sequence = make_sequence(make_steps(seed))
    odometry = read(sequence)
    assert sequence.odometry is not None
    np.testing.assert_allclose(odometry.world_from_vehicle, sequence.odometry.world_from_vehicle, atol=1e-12)
    np.testing.assert_array_equal(odometry.step_sigma, np.tile([0.005, 0.02], (COUNT - 1, 1)))
    assert odometry.diagnostics == () and not odometry.unreliable.any()


@pytest.mark.parametrize("step", [0, 1, 20, COUNT - 2])
@pytest.mark.parametrize("turned", [False, True])
def test_jump_is_replaced_and_reported(step: int, turned: bool) -> None:
    steps = make_steps()
    clean = chain_steps(np.eye(4), steps)
    jump = (
        make_pose(np.zeros(3), Rotation.from_rotvec([0, 0, 0.6]))
        if turned
        else make_pose(np.array([0.8, -0.6, 0.0]), Rotation.identity())
    )
    steps[step] = steps[step] @ jump
    odometry = read(make_sequence(steps))
    assert np.flatnonzero(odometry.unreliable).tolist() == [step]
    (found,) = odometry.diagnostics
    assert found.code == "odometry-jump" and found.frames == ((step, step + 1),)
    assert f"between frames {step} and {step + 1}" in found.message
    size_m = float(found.message.split("jumps by ")[1].split(" m")[0])
    assert size_m == pytest.approx(0.06 if turned else 1.0, abs=0.15)
    apart = invert(clean[step]) @ clean[step + 1]
    repaired = invert(odometry.world_from_vehicle[step]) @ odometry.world_from_vehicle[step + 1]
    error_m = np.linalg.norm((apart - repaired)[:3, 3])
    assert error_m < 0.1 < 3 * odometry.step_sigma[step, 1], "the sigma covers the error of the median"
    assert odometry.step_sigma[step, 0] > 0.005


def test_one_wrong_pose_makes_two_steps_unreliable() -> None:
    sequence = make_sequence(make_steps())
    assert sequence.odometry is not None
    poses = sequence.odometry.world_from_vehicle.copy()
    poses[15, :3, 3] += 1.0
    odometry = read(replace(sequence, odometry=replace(sequence.odometry, world_from_vehicle=poses)))
    assert np.flatnonzero(odometry.unreliable).tolist() == [14, 15]
    truth = sequence.odometry.world_from_vehicle
    assert np.abs((odometry.world_from_vehicle - truth)[:, :3, 3]).max() < 0.15


def test_missing_frames_and_manoeuvres_are_no_jumps() -> None:
    sequence = make_sequence(make_steps())
    keep = np.r_[0:12, 24:COUNT]
    lost = replace(sequence, timestamps_s=sequence.timestamps_s[keep])
    assert read(lost).diagnostics == ()
    steps = make_steps()
    steps[10:17, 0, 3] += 0.4
    assert read(make_sequence(steps)).diagnostics == ()


@pytest.mark.parametrize("lost", [range(15, 26), range(30, COUNT), range(0, 10)])
def test_steps_without_readings_get_large_sigmas(lost: range) -> None:
    sequence = make_sequence(make_steps())
    assert sequence.odometry is not None
    keep = ~np.isin(np.arange(COUNT), lost)
    cut = Trajectory(sequence.odometry.timestamps_s[keep], sequence.odometry.world_from_vehicle[keep])
    odometry = read(replace(sequence, odometry=cut))
    far = ~keep
    np.testing.assert_array_equal(odometry.unreliable, far[:-1] | far[1:])
    assert odometry.step_sigma[odometry.unreliable, 1].min() > 0.04
    np.testing.assert_array_equal(odometry.step_sigma[~odometry.unreliable, 1], 0.02)
    (found,) = odometry.diagnostics
    assert found.code == "odometry-gap" and found.frames == ((lost[0], lost[-1]),)
    assert f"{len(lost)} of {COUNT} frames ({lost[0]}-{lost[-1]})" in found.message


@pytest.mark.parametrize("count", [1, 2, 5])
def test_few_frames_are_not_filtered(count: int) -> None:
    sequence = make_sequence(make_steps())
    few = replace(sequence, timestamps_s=sequence.timestamps_s[:count])
    odometry = read(few)
    assert odometry.world_from_vehicle.shape == (count, 4, 4) and odometry.step_sigma.shape == (count - 1, 2)


def lose_frames(steps: FloatArray) -> Sequence:
    """Leave out the frames 12 to 23: the step 11 takes thirteen intervals."""
    sequence = make_sequence(steps)
    return replace(sequence, timestamps_s=sequence.timestamps_s[np.r_[0:12, 24:COUNT]])


def test_a_long_turn_over_missing_frames_is_no_jump() -> None:
    steps = make_steps() @ make_pose(np.zeros(3), Rotation.from_rotvec([0.0, 0.0, 0.09]))
    assert read(lose_frames(steps)).diagnostics == ()


def test_a_jump_over_missing_frames_is_replaced_by_as_many_median_steps() -> None:
    steps = make_steps()
    steps[18, :3, 3] += [6.0, -4.0, 0.0]
    odometry, ordinary = read(lose_frames(steps)), make_steps()
    assert np.flatnonzero(odometry.unreliable).tolist() == [11]
    repaired = invert(odometry.world_from_vehicle[11]) @ odometry.world_from_vehicle[12]
    median_m = np.median(ordinary[:, 0, 3])
    assert repaired[0, 3] == pytest.approx(13 * median_m, rel=0.3)
    typical_m = np.sqrt(np.mean(ordinary[:, :3, 3] ** 2))
    assert odometry.step_sigma[11, 1] == pytest.approx(1.5 * 13 * typical_m, rel=0.3)


def test_the_sigma_of_a_replaced_step_is_that_of_the_steps_that_do_not_jump() -> None:
    steps = make_steps()
    steps[20, :3, 3] += [3.0, -2.0, 0.0]
    typical_m = np.sqrt(np.mean(np.delete(make_steps(), 20, axis=0)[:, :3, 3] ** 2))
    assert read(make_sequence(steps)).step_sigma[20, 1] == pytest.approx(np.hypot(0.02, 1.5 * typical_m), rel=0.01)


def test_jumps_stay_unreliable_beside_a_gap() -> None:
    steps = make_steps()
    steps[5, :3, 3] += [3.0, -2.0, 0.0]
    sequence = make_sequence(steps)
    assert sequence.odometry is not None
    keep = ~np.isin(np.arange(COUNT), range(20, 31))
    cut = Trajectory(sequence.odometry.timestamps_s[keep], sequence.odometry.world_from_vehicle[keep])
    odometry = read(replace(sequence, odometry=cut))
    assert np.flatnonzero(odometry.unreliable).tolist() == [5, *range(19, 31)]
    assert [found.code for found in odometry.diagnostics] == ["odometry-jump", "odometry-gap"]


@pytest.mark.parametrize(("typical_m", "once_m", "jumps"), [(0.0, 0.1, 0), (0.0, 0.2, 1), (1.0, 2.5, 0), (1.0, 4.5, 1)])
def test_a_jump_exceeds_the_noise_and_the_steps_around_it(typical_m: float, once_m: float, jumps: int) -> None:
    """Eight sigmas of 0.02 m at rest, and three times the other steps in motion, however even they are."""
    steps = np.repeat(np.eye(4)[None], COUNT - 1, axis=0)
    steps[:, 0, 3] = typical_m
    steps[20, 0, 3] = once_m
    assert read(make_sequence(steps)).unreliable.sum() == jumps
