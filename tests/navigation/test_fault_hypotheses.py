"""Fault hypotheses: each undoes its fault, reversed axes of points, scales and their units, time offsets."""

from dataclasses import replace

import numpy as np
import pytest

from asfm.geometry.poses import steps_between
from asfm.navigation.fault_hypotheses import (
    EVERYTHING_MARINE,
    IMAGES_MIRRORED,
    ORDER_REVERSED,
    RANGE_REVERSED,
    Hypothesis,
    fault_hypotheses,
    hypothesis_distances,
    turned_points,
)
from asfm.navigation.odometry_hypotheses import AS_RECORDED, PointPairs, planar_inliers, to_marine_axes
from asfm.types import FloatArray
from tests.worlds import (
    VEHICLE_FRAMES,
    VEHICLE_LEVER_ARM,
    VEHICLE_SONAR,
    make_vehicle_path,
    observe_floor,
    pair_points,
)

TIMES_S: FloatArray = np.asarray(0.2 * np.arange(VEHICLE_FRAMES), dtype=np.float64)


@pytest.fixture(scope="module")
def raw() -> list[PointPairs]:
    return pair_points(observe_floor())


@pytest.fixture(scope="module")
def inliers(raw: list[PointPairs]) -> list[PointPairs]:
    return planar_inliers(raw, np.random.default_rng(0))


def hypothesise(poses: FloatArray, pairs: list[PointPairs]) -> dict[str, Hypothesis]:
    return {item.name: item for item in fault_hypotheses(poses, VEHICLE_LEVER_ARM, pairs, TIMES_S)}


def best(poses: FloatArray, raw: list[PointPairs], pairs: list[PointPairs]) -> tuple[str, dict[str, float]]:
    hypotheses = list(hypothesise(poses, pairs).values())
    distance_m = hypothesis_distances(hypotheses, raw, pairs, VEHICLE_LEVER_ARM, VEHICLE_SONAR)
    return min(distance_m, key=lambda name: distance_m[name]), distance_m


def test_recording_as_it_is_comes_first_and_conventions_before_the_rest(inliers: list[PointPairs]) -> None:
    names = list(hypothesise(make_vehicle_path(), inliers))
    assert names[:2] == [AS_RECORDED, EVERYTHING_MARINE] and {IMAGES_MIRRORED, RANGE_REVERSED} <= set(names[:5])


def test_marine_axes_are_undone_in_odometry_depth_and_attitude(inliers: list[PointPairs]) -> None:
    found = hypothesise(to_marine_axes(make_vehicle_path()), inliers)[EVERYTHING_MARINE]
    np.testing.assert_allclose(found.world_from_vehicle, make_vehicle_path(), atol=1e-12)
    assert found.reading_signs == (-1, 1, -1) and found.correctable and found.code == "marine-axes"


def test_quarter_turns_may_be_those_of_the_mounting(inliers: list[PointPairs]) -> None:
    turned = [item for item in hypothesise(make_vehicle_path(), inliers).values() if item.code == "mounting-rotated"]
    assert len(turned) == 3 and all("mounting" in item.name and item.correctable for item in turned)
    for item in turned:
        assert item.vehicle_from_sonar is not None
        other_mounting, other_axes = make_vehicle_path() @ item.vehicle_from_sonar, item.world_from_vehicle
        axes = (other_axes @ VEHICLE_LEVER_ARM)[:, :3, :3]
        np.testing.assert_allclose(other_mounting[:, :3, :3], axes, atol=1e-12)
        np.testing.assert_array_equal(item.vehicle_from_sonar[:3, 3], VEHICLE_LEVER_ARM[:3, 3])


@pytest.mark.parametrize(("axis", "column"), [("range", 0), ("bearing", 1)])
def test_points_of_a_reversed_axis_stay_in_the_image_and_turning_twice_changes_nothing(
    raw: list[PointPairs], axis: str, column: int
) -> None:
    once = turned_points(raw, axis, VEHICLE_SONAR)  # type: ignore[arg-type]
    twice = turned_points(once, axis, VEHICLE_SONAR)  # type: ignore[arg-type]
    edges = VEHICLE_SONAR.range_edges_m if axis == "range" else VEHICLE_SONAR.bearing_edges_rad
    for pair, turned, same in zip(raw, once, twice, strict=True):
        np.testing.assert_allclose(same.range_bearing_b, pair.range_bearing_b, atol=1e-12)
        np.testing.assert_array_equal(turned.range_bearing_a[:, 1 - column], pair.range_bearing_a[:, 1 - column])
        total = turned.range_bearing_b[:, column] + pair.range_bearing_b[:, column]
        np.testing.assert_allclose(total, edges[0] + edges[-1])


def test_reversed_ranges_fit_best_turned(raw: list[PointPairs]) -> None:
    wrong = turned_points(raw, "range", VEHICLE_SONAR)
    pairs = planar_inliers(wrong, np.random.default_rng(0))
    name, distance_m = best(make_vehicle_path(), wrong, pairs)
    assert name == RANGE_REVERSED and distance_m[name] < 0.6 * distance_m[AS_RECORDED]


def test_reversed_bearings_fit_as_well_as_any_when_turned(raw: list[PointPairs], inliers: list[PointPairs]) -> None:
    wrong = turned_points(raw, "bearing", VEHICLE_SONAR)
    pairs = turned_points(inliers, "bearing", VEHICLE_SONAR)
    _, distance_m = best(make_vehicle_path(), wrong, pairs)
    assert distance_m[IMAGES_MIRRORED] < 1.05 * min(distance_m.values()) < 0.6 * distance_m[AS_RECORDED]


def test_images_in_reversed_order_fit_best_so(raw: list[PointPairs], inliers: list[PointPairs]) -> None:
    name, _ = best(np.asarray(make_vehicle_path()[::-1]), raw, inliers)
    assert name == ORDER_REVERSED


@pytest.mark.parametrize(("factor", "unit"), [(1000.0, "mm"), (100.0, "cm"), (1 / 0.3048, "feet")])
def test_units_are_named_and_undone(raw: list[PointPairs], inliers: list[PointPairs], factor: float, unit: str) -> None:
    poses = make_vehicle_path()
    poses[:, :3, 3] *= factor
    name, _ = best(poses, raw, inliers)
    found = hypothesise(poses, inliers)[name]
    assert name == f"with its positions in {unit}" and found.correctable and found.code == "odometry-scale"
    np.testing.assert_allclose(
        steps_between(found.world_from_vehicle), steps_between(make_vehicle_path()), atol=1e-9 * max(factor, 1)
    )


def test_a_scale_that_a_range_window_may_have_is_only_reported(inliers: list[PointPairs]) -> None:
    for name, found in hypothesise(make_vehicle_path(), inliers).items():
        if "multiplied by" in name:
            factor = float(name.split()[-1])
            assert found.adoptable == (not 0.7 < factor < 1.4) or abs(factor - 0.7) < 0.01


def test_time_offsets_shift_whole_frames_and_leave_the_ends_unknown(inliers: list[PointPairs]) -> None:
    path = make_vehicle_path()
    shifted = [item for item in hypothesise(path, inliers).values() if item.code == "time-offset"]
    assert len(shifted) > 10 and not any(item.adoptable for item in shifted)
    late = next(item for item in shifted if item.name == "with its stamps 0.6 s too late")
    np.testing.assert_array_equal(late.world_from_vehicle[:-3], path[3:])
    assert np.isnan(late.world_from_vehicle[-3:]).all()


def test_hypotheses_without_enough_frame_pairs_are_not_chosen(raw: list[PointPairs], inliers: list[PointPairs]) -> None:
    unknown = Hypothesis("unknown", np.full((VEHICLE_FRAMES, 4, 4), np.nan))
    found = hypothesis_distances([unknown], raw, inliers, VEHICLE_LEVER_ARM, VEHICLE_SONAR)
    assert found == {"unknown": np.inf}


def test_nothing_moves_without_pairs_or_motion() -> None:
    still = np.tile(np.eye(4), (VEHICLE_FRAMES, 1, 1))
    names = [item.name for item in fault_hypotheses(still, VEHICLE_LEVER_ARM, [], TIMES_S)]
    assert names and not any("positions in" in name or "multiplied" in name for name in names)


def test_a_hypothesis_known_for_less_than_half_of_the_pairs_is_not_judged(
    raw: list[PointPairs], inliers: list[PointPairs]
) -> None:
    """Right poses of the first ten frames and of none after them."""
    partly = make_vehicle_path()
    partly[10:] = np.nan
    known = sum(pair.frame_b < 10 for pair in inliers)
    assert 0 < 2 * known < len(inliers)
    found = hypothesis_distances([Hypothesis("partly", partly)], raw, inliers, VEHICLE_LEVER_ARM, VEHICLE_SONAR)
    assert found == {"partly": np.inf}


def test_inliers_are_chosen_anew_where_ranges_are_turned(raw: list[PointPairs]) -> None:
    """More than half of the matches are wrong: those left after the axis is turned agree all the same."""
    rng, wrong = np.random.default_rng(5), turned_points(raw, "range", VEHICLE_SONAR)
    spoiled = []
    for pair in wrong:
        b = pair.range_bearing_b.copy()
        bad = rng.random(len(b)) < 0.55
        b[bad] = rng.uniform([1, -0.6], [9, 0.6], (int(bad.sum()), 2))
        spoiled.append(replace(pair, range_bearing_b=b))
    turned = Hypothesis(RANGE_REVERSED, make_vehicle_path(), images="range")
    pairs = planar_inliers(spoiled, np.random.default_rng(0))
    (distance_m,) = hypothesis_distances([turned], spoiled, pairs, VEHICLE_LEVER_ARM, VEHICLE_SONAR).values()
    assert distance_m < 0.06


def test_the_scale_is_that_of_the_longer_motions() -> None:
    """Six pairs that move give a median ratio of 2; five at rest, whose ratios are noise, do not count."""
    nothing, poses, pairs = np.zeros((0, 2)), np.tile(np.eye(4), (22, 1, 1)), []
    ratios = [1.5, 1.8, 2.0, 2.0, 2.2, 2.5] + [0.1] * 5
    for number, ratio in enumerate(ratios):
        planar_m = 1.0 if number < 6 else 0.01
        motion = np.eye(4)
        motion[0, 3] = planar_m
        poses[2 * number + 1, 0, 3] = planar_m / ratio
        pairs.append(PointPairs(2 * number, 2 * number + 1, nothing, nothing, motion))
    names = [item.name for item in fault_hypotheses(poses, np.eye(4), pairs, np.linspace(0.0, 4.2, 22))]
    assert "with its positions multiplied by 2" in names
