"""Odometry hypotheses: each undoes its fault, arc distances are zero under the truth, planar inliers are kept."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.geometry.planar_motion import estimate_planar_motion_msac
from asfm.geometry.poses import heading, invert, make_pose, transform
from asfm.geometry.sonar import project
from asfm.navigation.odometry_hypotheses import (
    AS_RECORDED,
    MARINE,
    MAX_FRAME_PAIRS,
    MAX_POINTS,
    MIN_INLIERS,
    PointPairs,
    collect_point_pairs,
    expected_arc_distance_m,
    median_arc_distance_m,
    odometry_hypotheses,
    planar_inliers,
    to_marine_axes,
)
from asfm.types import FloatArray, Keypoints, Matches
from tests.worlds import (
    VEHICLE_LEVER_ARM,
    VEHICLE_SONAR,
    make_vehicle_path,
    mirror_angle,
    mirror_axis,
    observe_floor,
    pair_points,
)


def swap_sides(poses: FloatArray) -> FloatArray:
    mirror_y = np.diag([1.0, -1.0, 1.0, 1.0])
    return np.asarray(mirror_y @ poses @ mirror_y)


def invert_rotations(poses: FloatArray) -> Rotation:
    return Rotation.from_matrix(poses[:, :3, :3]).inv()


def read_w_first(poses: FloatArray) -> FloatArray:
    """Read rows w x y z as x y z w."""
    written = np.roll(Rotation.from_matrix(poses[:, :3, :3]).as_quat(), 1, axis=1)
    return make_pose(poses[:, :3, 3], Rotation.from_quat(written))


def turn_body(degrees: float) -> Callable[[FloatArray], FloatArray]:
    turn = make_pose(np.zeros(3), Rotation.from_euler("z", degrees, degrees=True))
    return lambda poses: np.asarray(poses @ turn)


@pytest.mark.parametrize(
    ("name", "fault"),
    [
        (AS_RECORDED, lambda poses: poses),
        ("with its x axis mirrored", mirror_axis(0)),
        ("with its y axis mirrored", mirror_axis(1)),
        ("with its z axis mirrored", mirror_axis(2)),
        ("with its heading mirrored", mirror_angle(0)),
        ("with port and starboard swapped", swap_sides),
        ("inverted", invert),
        ("with its rotations inverted", lambda poses: make_pose(poses[:, :3, 3], invert_rotations(poses))),
        ("with its quaternions read as x y z w where w comes first", read_w_first),
        (MARINE, to_marine_axes),
        ("with its body axes (or the mounting of the sonar) turned by 90 deg about z", turn_body(-90)),
        ("with its body axes (or the mounting of the sonar) turned by 180 deg about z", turn_body(180)),
        ("with its body axes (or the mounting of the sonar) turned by -90 deg about z", turn_body(90)),
        ("taken as that of the sonar, without the lever arm", lambda poses: poses @ VEHICLE_LEVER_ARM),
    ],
)
def test_each_hypothesis_undoes_its_fault(name: str, fault: Callable[[FloatArray], FloatArray]) -> None:
    truth = make_vehicle_path()
    hypotheses = odometry_hypotheses(fault(truth), VEHICLE_LEVER_ARM)
    np.testing.assert_allclose(hypotheses[name], truth, atol=1e-9)
    assert len(hypotheses) == 14 and next(iter(hypotheses)) == AS_RECORDED


def test_without_a_lever_arm_none_can_be_missing() -> None:
    assert not any("lever arm" in name for name in odometry_hypotheses(make_vehicle_path(), np.eye(4)))


def test_mirrored_heading_keeps_position() -> None:
    truth = make_vehicle_path()
    mirrored = odometry_hypotheses(truth, np.eye(4))["with its heading mirrored"]
    np.testing.assert_allclose(heading(mirrored), -heading(truth), atol=1e-12)
    np.testing.assert_array_equal(mirrored[:, :3, 3], truth[:, :3, 3])


def make_exact_pair(world_from_sonar: FloatArray) -> PointPairs:
    """Points in the middle of the beam of frame 0, as frames 0 and 1 see them."""
    rng = np.random.default_rng(0)
    in_a = np.column_stack([rng.uniform([3, -1], [6, 1], (30, 2)), np.zeros(30)])
    in_b = transform(invert(world_from_sonar[1]) @ world_from_sonar[0], in_a)
    a, b = (np.stack(project(points)[:2], axis=1) for points in (in_a, in_b))
    return PointPairs(0, 1, a, b, np.eye(4))


def test_arc_distance_is_zero_under_the_truth_and_the_length_of_a_wrong_step() -> None:
    poses = (make_vehicle_path() @ VEHICLE_LEVER_ARM)[[0, 4]]
    pair = make_exact_pair(poses)
    assert median_arc_distance_m(pair, poses, VEHICLE_SONAR) < 1e-9
    wrong = poses.copy()
    wrong[1] = poses[1] @ make_pose(np.array([0.5, 0.0, 0.0]), Rotation.identity())
    assert median_arc_distance_m(pair, wrong, VEHICLE_SONAR) == pytest.approx(0.5, abs=0.1)
    other = make_pose(np.array([4.0, 2.0, -1.0]), Rotation.from_euler("ZYX", [1.0, 0.3, -0.2]))
    assert median_arc_distance_m(pair, other @ wrong, VEHICLE_SONAR) == pytest.approx(
        median_arc_distance_m(pair, wrong, VEHICLE_SONAR), abs=1e-9
    )


def test_arcs_are_those_of_the_pair_and_the_sonar_that_are_given() -> None:
    """They are kept from one call to the next: neither another aperture nor other points may get them."""
    poses = (make_vehicle_path() @ VEHICLE_LEVER_ARM)[[0, 4]]
    pair, high = make_exact_pair(poses), poses.copy()
    high[1] = poses[1] @ make_pose(np.array([0.0, 0.0, 0.5]), Rotation.identity())
    narrow = replace(VEHICLE_SONAR, elevation_aperture_rad=VEHICLE_SONAR.elevation_aperture_rad / 10)
    wide_m, narrow_m = (median_arc_distance_m(pair, high, sonar) for sonar in (VEHICLE_SONAR, narrow))
    assert abs(wide_m - narrow_m) > 1e-3
    further = replace(pair, range_bearing_a=pair.range_bearing_a + np.array([1.0, 0.0]))
    assert median_arc_distance_m(further, poses, VEHICLE_SONAR) == pytest.approx(1.0, abs=0.1)
    assert median_arc_distance_m(pair, high, VEHICLE_SONAR) == wide_m


def test_expected_distance_grows_with_each_noise_and_the_gap() -> None:
    pair = make_exact_pair(np.tile(np.eye(4), (2, 1, 1)))
    features, steps = np.array([0.015, 0.005]), np.tile([0.005, 0.02], (5, 1))
    base = expected_arc_distance_m(pair, features, steps)
    range_m = float(np.median(pair.range_bearing_b[:, 0]))
    variance = 2 * 0.015**2 + 2 * (range_m * 0.005) ** 2 + 2 * 0.02**2 + (range_m * 0.005) ** 2
    assert base == pytest.approx(np.sqrt(variance))
    assert (
        expected_arc_distance_m(pair, 2 * features, steps) > base < expected_arc_distance_m(pair, features, 2 * steps)
    )
    wide = replace(pair, frame_a=4, frame_b=0)
    assert expected_arc_distance_m(wide, np.zeros(2), steps) == pytest.approx(
        2 * expected_arc_distance_m(pair, np.zeros(2), steps)
    )


def test_planar_inliers_are_kept_without_the_planted_outliers() -> None:
    pairs = [pair for pair in pair_points(observe_floor()) if len(pair.range_bearing_a) >= 4 * MIN_INLIERS][:20]
    spoiled = []
    for pair in pairs:
        b = pair.range_bearing_b.copy()
        b[::5, 0] += 1.5
        spoiled.append(replace(pair, range_bearing_b=b))
    found = planar_inliers(spoiled, np.random.default_rng(0))
    assert len(found) == len(pairs) > 10
    for pair, spoilt in zip(found, spoiled, strict=True):
        kept = np.flatnonzero(np.isin(spoilt.range_bearing_b[:, 0], pair.range_bearing_b[:, 0]))
        assert MIN_INLIERS <= len(pair.range_bearing_a) <= MAX_POINTS and np.mean(kept % 5 == 0) < 0.05
        xy_a, xy_b = (
            polar[:, :1] * np.stack([np.cos(polar[:, 1]), np.sin(polar[:, 1])], axis=1)
            for polar in (pair.range_bearing_a, pair.range_bearing_b)
        )
        everyone = np.stack([np.zeros(1, int), np.ones(1, int)], axis=1)
        _, inlier = estimate_planar_motion_msac(xy_a, xy_b, np.full(len(xy_a), 100.0), everyone)
        assert inlier.all()
        off_m = np.linalg.norm(
            transform(pair.a_from_b, np.column_stack([xy_b, np.zeros(len(xy_b))]))[:, :2] - xy_a, axis=1
        )
        assert (off_m < 0.03 * pair.range_bearing_b[:, 0] + 1e-9).all()


def test_pairs_without_a_common_motion_or_with_few_points_are_dropped_and_their_number_is_bounded() -> None:
    rng = np.random.default_rng(1)
    one, other = rng.uniform([1, -0.6], [9, 0.6], (2, 60, 2))
    random = PointPairs(0, 1, one, other, np.eye(4))
    few = PointPairs(1, 2, one[: MIN_INLIERS - 1], one[: MIN_INLIERS - 1], np.eye(4))
    assert planar_inliers([random, few], rng) == [] == planar_inliers([], rng)
    same = rng.uniform([1, -0.6], [9, 0.6], (20, 2))
    many = [PointPairs(frame, frame + 1, same, same, np.eye(4)) for frame in range(200)]
    found = planar_inliers(many, rng)
    assert len(found) == MAX_FRAME_PAIRS and found[0].frame_a == 0 and found[-1].frame_a == 199


def test_points_that_only_the_prediction_rejected_are_collected() -> None:
    rng = np.random.default_rng(2)
    descriptors, patches = np.zeros((6, 8), np.uint8), np.zeros((0, 3, 3), np.float32)
    keypoints = []
    for _ in range(5):
        place = rng.uniform(1, 5, (6, 2))
        keypoints.append(Keypoints(place, place[:, 0], place[:, 1], np.ones(6), descriptors, patches))
    index, rejected = np.array([[0, 1], [2, 3]]), np.array([[4, 5], [5, 4]])
    matches = Matches(
        0, 2, index, np.zeros(2), rejected=rejected, rejected_by=np.array([1, 0]), filters=("ratio", "arc")
    )
    too_far = replace(matches, frame_b=3)
    (pair,) = collect_point_pairs(keypoints, [matches, too_far])
    np.testing.assert_array_equal(pair.range_bearing_a, keypoints[0].range_bearing[[0, 2, 4]])
    np.testing.assert_array_equal(pair.range_bearing_b, keypoints[2].range_bearing[[1, 3, 5]])


def test_pairs_of_which_a_small_share_agrees_are_dropped() -> None:
    """Twelve points of a hundred and twenty agree on a motion: others agree so by chance."""
    rng = np.random.default_rng(3)
    one, other = rng.uniform([1, -0.6], [9, 0.6], (2, 120, 2))
    other[:12] = one[:12]
    pair = PointPairs(0, 1, one, other, np.eye(4))
    same = replace(pair, range_bearing_a=one[:12], range_bearing_b=one[:12])
    assert planar_inliers([pair], rng) == [] and len(planar_inliers([same], rng)) == 1


def test_arc_distance_across_the_beam_is_in_metres_and_takes_the_short_way_round() -> None:
    poses = (make_vehicle_path() @ VEHICLE_LEVER_ARM)[[0, 4]]
    pair = make_exact_pair(poses)
    aside = replace(pair, range_bearing_b=pair.range_bearing_b + np.array([0.0, 0.05]))
    expected_m = 0.05 * float(np.median(pair.range_bearing_b[:, 0]))
    assert 0.6 * expected_m < median_arc_distance_m(aside, poses, VEHICLE_SONAR) <= 1.01 * expected_m
    half_turn = make_pose(np.zeros(3), Rotation.from_rotvec([0.0, 0.0, np.pi]))
    astern = replace(
        aside,
        range_bearing_a=aside.range_bearing_a + np.array([0.0, np.pi]),
        range_bearing_b=aside.range_bearing_b - np.array([0.0, np.pi]),
    )
    found_m = median_arc_distance_m(astern, poses @ half_turn, VEHICLE_SONAR)
    assert found_m == pytest.approx(median_arc_distance_m(aside, poses, VEHICLE_SONAR), abs=1e-9)
