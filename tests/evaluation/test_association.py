"""Association in time: interpolation, its limits, and what is left out."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from asfm.errors import AsfmError
from asfm.evaluation.association import associate, within_reach
from asfm.evaluation.trajectory import absolute_errors, align_se3
from asfm.geometry.poses import make_pose
from asfm.types import FloatArray, Trajectory


def random_walk(seed: int, count: int = 40) -> FloatArray:
    rng = np.random.default_rng(seed)
    return make_pose(np.cumsum(rng.normal(size=(count, 3)), axis=0), Rotation.random(count, rng))


def with_stamps(poses: FloatArray, start_s: float = 0.0) -> Trajectory:
    return Trajectory(start_s + 0.2 * np.arange(float(len(poses))), poses)


def half_circle(at_s: FloatArray, radius_m: float = 10.0) -> Trajectory:
    """A half circle in 20 s, as in the field's worst references."""
    turn = np.pi * at_s / 20
    xyz_m = radius_m * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    return Trajectory(at_s, make_pose(xyz_m, Rotation.from_rotvec(turn[:, None] * [0, 0, 1])))


def worst_error_m(estimate: Trajectory, reference: Trajectory) -> float:
    pairs = associate(estimate, reference)
    return float(absolute_errors(align_se3(pairs.estimate, pairs.reference) @ pairs.estimate, pairs.reference)[0].max())


FRAMES = half_circle(np.arange(0, 20.01, 0.5))


def test_association_interpolates_the_reference() -> None:
    reference = random_walk(5, 4)
    at_s = np.array([0.0, 0.1, 0.5, 0.6])
    pairs = associate(Trajectory(at_s, random_walk(6, 4)), with_stamps(reference))
    np.testing.assert_array_equal(pairs.timestamps_s, at_s)
    np.testing.assert_allclose(pairs.reference[0], reference[0], atol=1e-9)
    np.testing.assert_allclose(pairs.reference[1, :3, 3], reference[:2, :3, 3].mean(axis=0))
    half = Rotation.from_matrix(reference[:2, :3, :3]).mean()
    assert (half.inv() * Rotation.from_matrix(pairs.reference[1, :3, :3])).magnitude() < 1e-7


def test_poses_outside_the_reference_are_left_out() -> None:
    estimate = with_stamps(random_walk(5, 20))
    reference = with_stamps(random_walk(6, 5), start_s=1.0)
    pairs = associate(estimate, reference)
    np.testing.assert_allclose(pairs.timestamps_s, [1.0, 1.2, 1.4, 1.6, 1.8])
    np.testing.assert_array_equal(pairs.estimate, estimate.world_from_vehicle[5:10])


def test_rounded_stamps_at_the_ends_are_kept() -> None:
    reference = with_stamps(random_walk(6, 5))
    shifted = Trajectory(reference.timestamps_s + np.array([-4e-4, 0, 0, 0, 4e-4]), reference.world_from_vehicle)
    assert len(associate(shifted, reference)) == 5


@pytest.mark.parametrize(("start_s", "count"), [(100.0, 5), (0.8, 5), (0.0, 1), (0.0, 0)])
def test_too_little_common_time_is_an_error_with_both_spans(start_s: float, count: int) -> None:
    estimate = with_stamps(random_walk(1, count), start_s)
    with pytest.raises(AsfmError) as caught:
        associate(estimate, with_stamps(random_walk(2, 5)))
    message = str(caught.value)
    assert "0.000 to 0.800 s" in message
    assert "has no poses" in message if count == 0 else f"{start_s:.3f} to" in message
    assert "\n" not in message


def test_an_empty_reference_is_an_error() -> None:
    with pytest.raises(AsfmError, match="the reference has no poses"):
        associate(with_stamps(random_walk(1, 5)), with_stamps(random_walk(2, 0)))


def test_a_pose_that_is_not_finite_is_an_error() -> None:
    broken = random_walk(1, 5)
    broken[3, 0, 3] = np.nan
    with pytest.raises(AsfmError, match="estimate, pose 3"):
        associate(with_stamps(broken), with_stamps(random_walk(2, 5)))


@pytest.mark.parametrize("outside_s", [0.01, 0.1])
def test_stamps_clearly_outside_the_reference_are_not_extrapolated(outside_s: float) -> None:
    stamps_s = np.arange(5.0)
    still = np.tile(np.eye(4), (5, 1, 1))
    at_s = np.array([-outside_s, 0.5, 2.0, 3.5, 4.0 + outside_s])
    pairs = associate(Trajectory(at_s, still), Trajectory(stamps_s, still))
    np.testing.assert_array_equal(pairs.timestamps_s, at_s[1:-1])


@given(st.floats(1.5, 18), st.floats(1.6, 18), st.sampled_from([0.1, 0.25, 0.5]))
def test_nothing_is_interpolated_across_a_gap(begin_s: float, length_s: float, interval_s: float) -> None:
    """The estimate is the truth: straight lines through a gap would be its errors."""
    stamps_s = np.arange(0, 20.01, interval_s)
    kept_s = stamps_s[(stamps_s <= begin_s) | (stamps_s >= begin_s + length_s)]
    reference = half_circle(kept_s)
    pairs = associate(FRAMES, reference)
    inside = (pairs.timestamps_s > begin_s + 1e-6) & (pairs.timestamps_s < begin_s + length_s - 1e-6)
    assert not inside.any() or length_s <= max(1.0, 3 * interval_s) + 2 * interval_s
    assert worst_error_m(FRAMES, reference) < 0.13  # sagitta of what may be bridged: 1.5 s


@pytest.mark.parametrize("interval_s", [2.0, 5.0, 10.0])
@pytest.mark.parametrize("offset_s", [0.0, 0.2])
def test_a_rare_reference_is_compared_at_its_own_stamps(interval_s: float, offset_s: float) -> None:
    reference = half_circle(np.arange(offset_s, 20.0, interval_s))
    np.testing.assert_allclose(associate(FRAMES, reference).timestamps_s, reference.timestamps_s)
    sagitta_m = 10 * (1 - np.cos(np.pi * 0.5 / 20 / 2))  # of the estimate between two frames
    assert worst_error_m(FRAMES, reference) < (1e-9 if offset_s == 0 else 1.5 * sagitta_m)


def test_a_reference_of_one_hertz_with_jitter_covers_every_frame() -> None:
    stamps_s = np.arange(0, 21.0) + np.random.default_rng(0).uniform(-0.1, 0.1, 21)
    stamps_s[[0, -1]] = 0.0, 20.0
    assert within_reach(FRAMES.timestamps_s, stamps_s).all()
    assert within_reach(FRAMES.timestamps_s, np.delete(stamps_s, 7)).all(), "one missing pose is bridged"


def test_errors_are_the_same_with_either_trajectory_far_from_its_origin() -> None:
    """Also where rotations are only orthonormal to single precision, as simulators write them."""
    reference = with_stamps(random_walk(3))
    noise_m = np.random.default_rng(1).normal(0, 0.1, (40, 3))
    estimate = with_stamps(make_pose(reference.world_from_vehicle[:, :3, 3] + noise_m, Rotation.identity(40)))
    near = associate(estimate, reference)
    for which in (0, 1):
        moved = [estimate, reference]
        poses = moved[which].world_from_vehicle.copy()
        poses[:, :3, 3] += [5e5, 5.572e6, -30.0]
        moved[which] = Trajectory(moved[which].timestamps_s, poses)
        far = associate(*moved)
        for a, b in ((near.estimate, far.estimate), (near.reference, far.reference)):
            np.testing.assert_allclose(b[:, :3, 3] - b[0, :3, 3], a[:, :3, 3] - a[0, :3, 3], atol=3e-9)
            assert np.abs(b[:, :3, 3]).max() < 1e3


def test_a_rounded_stamp_beside_a_gap_takes_the_pose_before_it() -> None:
    """The reference is lost for a hundred seconds and comes back a kilometre farther."""
    reference = random_walk(3, 20)
    reference[10:, 0, 3] += 1000.0
    stamps_s = 0.2 * np.arange(20.0) + np.where(np.arange(20) >= 10, 100.0, 0.0)
    rounded_s = stamps_s + np.where(np.arange(20) == 9, 9e-4, 0.0)
    pairs = associate(Trajectory(rounded_s, random_walk(4, 20)), Trajectory(stamps_s, reference))
    steps_m = np.linalg.norm(np.diff(reference[:10, :3, 3], axis=0), axis=1)
    found_m = np.linalg.norm(np.diff(pairs.reference[:10, :3, 3], axis=0), axis=1)
    np.testing.assert_allclose(found_m, steps_m, atol=1e-9)
