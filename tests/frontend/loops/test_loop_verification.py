"""Verification of loops on made-up scenes whose true associations are known: right ones pass, look-alikes never do."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.config import Config
from asfm.frontend.loops.false_alarms import log_false_alarms
from asfm.frontend.loops.keypoint_tracks import KeypointTracks
from asfm.frontend.loops.loop_check import LoopCheck, are_mutually_consistent
from asfm.frontend.loops.loop_verification import verify_loop
from asfm.frontend.matching.pair_matching import match_pairs
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import SonarModel, project
from asfm.navigation.pose_prediction import PosePrediction
from asfm.types import FloatArray, IntArray, Keypoints, Tracks

SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.6, 0.6), (600, 256), np.deg2rad(20))
CONFIG = Config()
WIDTH = 2 * CONFIG.patch_radius_px + 1
NONE = np.zeros(0, dtype=np.int64)
NO_TRACKS = Tracks(NONE, NONE, np.zeros(0), np.zeros(0), keypoint=NONE)


@dataclass(frozen=True)
class Scene:
    """Points with what a sonar would see of each: points that look alike share a look."""

    xyz_m: FloatArray
    look: IntArray


@dataclass(frozen=True)
class Sight:
    """One frame of a scene."""

    keypoints: Keypoints
    point: IntArray
    """(K,) the scene's point behind each keypoint; -1 for clutter."""


def see(scene: Scene, world_from_sonar: FloatArray, rng: np.random.Generator, clutter: int = 40) -> Sight:
    """Detect most of what lies in the frustum, with noise in place, descriptor and square, among clutter."""
    in_sonar = transform(invert(world_from_sonar), scene.xyz_m)
    point = np.flatnonzero(SONAR.sees(in_sonar) & (rng.random(len(in_sonar)) < 0.7))
    range_m, bearing_rad, _ = project(in_sonar[point])
    range_m = np.concatenate([range_m + rng.normal(0, 0.015, len(point)), rng.uniform(1, 9.5, clutter)])
    bearing_rad = np.concatenate([bearing_rad + rng.normal(0, 0.004, len(point)), rng.uniform(-0.6, 0.6, clutter)])
    looks = [np.random.default_rng(1000 + look) for look in scene.look[point].tolist()] + [rng] * clutter
    descriptors = np.stack([look.integers(0, 256, 61, dtype=np.uint8) for look in looks])
    squares = np.stack([look.random((WIDTH, WIDTH), np.float32) for look in looks])
    descriptors = descriptors ^ np.packbits(rng.random((len(looks), 488)) < 0.08, axis=1)
    squares = squares + 0.1 * rng.random(squares.shape, np.float32)
    row_column = np.stack([SONAR.row_at_range(range_m), SONAR.column_at_bearing(bearing_rad)], axis=1)
    keypoints = Keypoints(row_column, range_m, bearing_rad, np.ones(len(looks)), descriptors, squares)
    return Sight(keypoints, np.concatenate([point, np.full(clutter, -1)]))


def make_random_scene(rng: np.random.Generator, count: int = 300) -> Scene:
    """Points of their own looks over a bottom of 24 m by 24 m."""
    return Scene(rng.uniform([-12, -12, -0.3], [12, 12, 0.3], (count, 3)), np.arange(count))


def make_row_of_piles(rng: np.random.Generator, spacing_m: float, own_looks: int = 0) -> Scene:
    """Piles in a row along y, each of the same 40 points with the same looks; and some points of their own looks."""
    pile = rng.uniform([-0.3, -0.3, -0.3], [0.3, 0.3, 0.3], (40, 3)) + np.array([5.0, 0.0, 0.0])
    places = spacing_m * np.arange(-8, 9)
    piles = (pile[None] + places[:, None, None] * np.array([0.0, 1.0, 0.0])).reshape(-1, 3)
    ground = rng.uniform([3, -10, -0.3], [9, 10, 0.3], (own_looks, 3))
    looks = np.concatenate([np.tile(np.arange(40), len(places)), 100 + np.arange(own_looks)])
    return Scene(np.concatenate([piles, ground]), looks)


def at(y_m: float, yaw_rad: float = 0.0) -> FloatArray:
    return make_pose(np.array([0.0, y_m, 0.0]), Rotation.from_euler("z", yaw_rad))


def judge(
    sights: list[Sight], believed: FloatArray, shift_m: float, turn_rad: float, tracks: Tracks = NO_TRACKS
) -> tuple[LoopCheck, float]:
    """Match and verify frames 0 and 1; give the check and the share of its matches that join one point."""
    keypoints = [sight.keypoints for sight in sights]
    predicted = PosePrediction(believed, turn_rad, shift_m)
    (matches,) = match_pairs([(0, 1)], keypoints, CONFIG, SONAR, predicted)
    tracked = KeypointTracks(tracks, keypoints, SONAR, CONFIG.noise, np.ones(len(tracks), dtype=bool))
    check = verify_loop(matches, keypoints, SONAR, predicted, tracked, CONFIG)
    a, b = (sight.point[which] for sight, which in zip(sights[:2], check.matches.index.T, strict=True))
    return check, float(np.mean((a == b) & (a >= 0))) if len(a) else 0.0


@pytest.mark.parametrize("seed", range(4))
def test_a_place_seen_again_is_accepted(seed: int) -> None:
    """The prediction is wrong by 0.3 m, as it says it may be; the check tells by how much."""
    rng = np.random.default_rng(seed)
    scene, poses = make_random_scene(rng), [at(0.0), at(0.5, 0.1)]
    sights = [see(scene, pose, rng) for pose in poses]
    check, right = judge(sights, np.stack([at(0.0), at(0.8, 0.1)]), 0.2, 0.03)
    assert check.accepted and len(check.matches) >= CONFIG.loops.min_matches
    assert right > 0.95
    np.testing.assert_allclose(check.shift_m, [0.0, -0.3], atol=0.1)


@pytest.mark.parametrize("seed", range(4))
def test_two_places_are_not_accepted(seed: int) -> None:
    rng = np.random.default_rng(seed)
    sights = [see(make_random_scene(rng), at(0.0), rng), see(make_random_scene(rng), at(0.0), rng)]
    sights = [sights[0], Sight(_other_looks(sights[1].keypoints, rng), sights[1].point)]
    check, _ = judge(sights, np.stack([at(0.0), at(0.0)]), 1.0, 0.2)
    assert not check.accepted


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("spacing_m", [1.0, 1.8])
@pytest.mark.parametrize("sigma_m", [0.2, 0.6, 2.0])
def test_equal_piles_alone_close_no_loop(seed: int, spacing_m: float, sigma_m: float) -> None:
    """The odometry is off by one spacing, which puts the wrong piles where the right ones are expected."""
    rng = np.random.default_rng(seed)
    scene = make_row_of_piles(rng, spacing_m)
    sights = [see(scene, at(0.0), rng), see(scene, at(0.3), rng)]
    check, _ = judge(sights, np.stack([at(0.0), at(0.3 + spacing_m)]), sigma_m, 0.02)
    assert not check.accepted


@pytest.mark.parametrize("seed", range(3))
def test_equal_piles_among_distinct_points_close_the_right_loop(seed: int) -> None:
    """The same wrong odometry, stated as uncertain: the points around the piles decide."""
    rng = np.random.default_rng(seed)
    scene = make_row_of_piles(rng, 1.8, own_looks=250)
    sights = [see(scene, at(0.0), rng), see(scene, at(0.3), rng)]
    check, right = judge(sights, np.stack([at(0.0), at(0.3 + 1.8)]), 2.0, 0.02)
    assert check.accepted and right > 0.95
    np.testing.assert_allclose(check.shift_m, [0.0, -1.8], atol=0.1)


@pytest.mark.parametrize("seed", range(3))
def test_piles_that_one_frame_sees_apart_are_not_one(seed: int) -> None:
    """Each frame sees one of two equal piles, and a third sees both: what it tracked contradicts the loop."""
    rng = np.random.default_rng(seed)
    scene = make_row_of_piles(rng, 4.2)
    sights = [see(scene, at(y_m), rng, clutter=0) for y_m in (0.0, 4.2, 2.1)]
    believed = np.stack([at(0.0), at(0.0), at(2.1)])
    alone, right = judge(sights, believed, 0.3, 0.02)
    assert alone.accepted and right == 0.0  # the frames alone cannot tell
    told, _ = judge(sights, believed, 0.3, 0.02, _track(sights))
    assert told.reason == "conflicts"


@pytest.mark.parametrize("seed", range(3))
def test_one_thing_alike_in_two_places_is_not_enough(seed: int) -> None:
    """Equal piles on ground of its own looks each: the piles match, and nothing around them does."""
    rng = np.random.default_rng(seed)
    scene = make_row_of_piles(rng, 6.0, own_looks=250)
    sights = [see(scene, at(0.0), rng), see(scene, at(6.0), rng)]
    check, right = judge(sights, np.stack([at(0.0), at(0.0)]), 0.3, 0.02)
    assert check.reason == "coverage" and right == 0.0
    again, right = judge([sights[0], see(scene, at(0.2), rng)], np.stack([at(0.0), at(0.0)]), 0.3, 0.02)
    assert again.accepted and right > 0.95


def test_without_a_prediction_worth_its_name_an_ambiguous_scene_is_not_closed() -> None:
    """True association is possible but so is another: whatever is right, the pair is ambiguous."""
    rng = np.random.default_rng(0)
    scene = make_row_of_piles(rng, 1.0)
    sights = [see(scene, at(0.0), rng, 0), see(scene, at(0.0), rng, 0)]
    check, _ = judge(sights, np.stack([at(0.0), at(0.0)]), 1.0, 0.02)
    assert not check.accepted


def test_chance_is_ruled_out_by_many_and_not_by_few() -> None:
    beside = np.zeros((100, 100), dtype=bool)
    beside[:12, :2] = True  # each motion-predicted place holds two of a hundred keypoints
    assert log_false_alarms(40, 4, beside) > -2
    assert log_false_alarms(40, 14, beside) < -6
    alarms = [log_false_alarms(40, agree, beside) for agree in range(3, 40)]
    assert (np.diff(alarms) < 0).all()
    assert log_false_alarms(400, 12, beside) > log_false_alarms(40, 12, beside)


def test_neighbours_support_what_they_agree_with() -> None:
    rng = np.random.default_rng(1)
    scene = make_random_scene(rng)
    sights = [see(scene, at(0.0), rng), see(scene, at(0.5), rng)]
    first, _ = judge(sights, np.stack([at(0.0), at(0.7)]), 0.2, 0.03)
    again, _ = judge(sights, np.stack([at(0.0), at(0.7)]), 0.2, 0.03)
    other, _ = judge(sights, np.stack([at(0.0), at(-0.2)]), 0.4, 0.03)
    assert first.accepted and other.accepted
    assert not are_mutually_consistent(first, again, 8)  # a pair does not support itself
    assert are_mutually_consistent(first, _at_frames(again, 1, 2), 8)
    assert not are_mutually_consistent(first, _at_frames(again, 1, 20), 8)
    assert not are_mutually_consistent(first, _at_frames(other, 1, 2), 8)


def _at_frames(check: LoopCheck, frame_a: int, frame_b: int) -> LoopCheck:
    return replace(check, matches=replace(check.matches, frame_a=frame_a, frame_b=frame_b))


def _other_looks(keypoints: Keypoints, rng: np.random.Generator) -> Keypoints:
    descriptors = rng.integers(0, 256, keypoints.descriptors.shape, dtype=np.uint8)
    return replace(keypoints, descriptors=descriptors, patches=rng.random(keypoints.patches.shape, np.float32))


def _track(sights: list[Sight]) -> Tracks:
    """Join all that is one point, over all frames."""
    frame = np.repeat(np.arange(len(sights)), [len(sight.point) for sight in sights])
    point = np.concatenate([sight.point for sight in sights])
    places = [
        np.concatenate([getattr(sight.keypoints, name) for sight in sights]) for name in ("range_m", "bearing_rad")
    ]
    order = np.lexsort((frame, point))
    order = order[point[order] >= 0]
    _, track = np.unique(point[order], return_inverse=True)
    keypoint = np.concatenate([np.arange(len(sight.point)) for sight in sights])
    range_m, bearing_rad = (place[order] for place in places)
    return Tracks(track.astype(np.int64), frame[order], range_m, bearing_rad, keypoint=keypoint[order])
