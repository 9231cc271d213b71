"""Re-matching on keypoints of random points: tracks get back what they lack, and nothing else."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.config import Config
from asfm.frontend.tracking.guided_matching import add_matches, match_to_landmarks
from asfm.frontend.tracking.track_builder import build_tracks
from asfm.frontend.tracking.triangulated_tracks import TriangulatedTracks, predict_observations
from asfm.geometry.feature_noise import feature_sigma
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import SonarModel, back_project, project
from asfm.types import BoolArray, Descriptors, FloatArray, IntArray, Keypoints, Matches, Tracks

SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.7, 0.7), (600, 256), 0.35)
CONFIG = Config()
FRAMES, POINTS, WINDOW = 9, 50, 16


@dataclass(frozen=True)
class World:
    """Points that every frame sees; keypoint k of every frame shows point order[frame][k]."""

    xyz_m: FloatArray
    world_from_sonar: FloatArray
    keypoints: list[Keypoints]
    order: list[IntArray]

    def solve(self, label: IntArray) -> TriangulatedTracks:
        """Give tracks of the observations whose (frame, point) has a label of 0 or more, with their true points."""
        frame, keypoint = (value.ravel() for value in np.indices((FRAMES, POINTS)))
        point = np.stack(self.order)[frame, keypoint]
        named = label[frame, point] >= 0
        frame, keypoint, point = frame[named], keypoint[named], point[named]
        _, track = np.unique(label[frame, point], return_inverse=True)
        order = np.lexsort((frame, track))
        frame, keypoint, point, track = frame[order], keypoint[order], point[order], track[order]
        range_m, bearing_rad = (
            np.array([getattr(self.keypoints[f], name)[k] for f, k in zip(frame, keypoint, strict=True)])
            for name in ("range_m", "bearing_rad")
        )
        of_track = point[np.searchsorted(track, np.arange(track[-1] + 1))]
        return TriangulatedTracks(
            Tracks(track, frame, range_m, bearing_rad, keypoint=keypoint),
            self.keypoints,
            self.xyz_m[of_track],
            np.ones(len(of_track), dtype=bool),
            self.world_from_sonar,
            SONAR,
            CONFIG,
        )

    def points_of(self, match: Matches) -> tuple[IntArray, IntArray]:
        return self.order[match.frame_a][match.index[:, 0]], self.order[match.frame_b][match.index[:, 1]]


def make_world(seed: int = 0, noise: float = 0.5) -> World:
    """Poses that heave and roll, so that elevations are told; descriptors of a point differ in a few bits."""
    rng = np.random.default_rng(seed)
    step = np.arange(FRAMES)
    xyz_m = np.stack([0.05 * step, 0.05 * step, 0.1 * np.sin(step)], axis=1)
    poses = make_pose(xyz_m, Rotation.from_euler("ZYX", np.stack([0.01 * step, 0 * step, 0.4 * np.sin(step)], 1)))
    points = back_project(rng.uniform(3, 8, POINTS), rng.uniform(-0.4, 0.4, POINTS), rng.uniform(-0.02, 0.02, POINTS))
    looks = rng.integers(0, 256, (POINTS, 61), dtype=np.uint8)
    sigma = noise * feature_sigma(SONAR, CONFIG.noise)
    keypoints, order = [], []
    for pose in poses:
        shown = rng.permutation(POINTS)
        range_m, bearing_rad, _ = project(transform(invert(pose), points[shown]))
        flips = np.uint8(1) << rng.integers(0, 8, (POINTS, 61), dtype=np.uint8)
        flips[rng.random((POINTS, 61)) > 0.2] = 0
        place = range_m + rng.normal(0, sigma[0], POINTS), bearing_rad + rng.normal(0, sigma[1], POINTS)
        keypoints.append(keypoints_at(*place, looks[shown] ^ flips))
        order.append(shown)
    return World(points, poses, keypoints, order)


def keypoints_at(range_m: FloatArray, bearing_rad: FloatArray, descriptors: Descriptors) -> Keypoints:
    place = np.stack([SONAR.row_at_range(range_m), SONAR.column_at_bearing(bearing_rad)], axis=1)
    squares = np.zeros((len(range_m), 3, 3), dtype=np.float32)
    return Keypoints(place, range_m, bearing_rad, np.ones(len(range_m)), descriptors, squares)


def one_label_each() -> IntArray:
    return np.tile(np.arange(POINTS), (FRAMES, 1))


def chain(triangulated: TriangulatedTracks) -> list[Matches]:
    """The matches that the tracks of a solution were made of: each observation with the next."""
    tracks, found = triangulated.tracks, []
    for here in np.flatnonzero(np.diff(tracks.track) == 0):
        pair = np.array([[triangulated.keypoint[here], triangulated.keypoint[here + 1]]])
        found.append(Matches(int(tracks.frame[here]), int(tracks.frame[here + 1]), pair, np.zeros(1)))
    return found


def rebuild(triangulated: TriangulatedTracks, window: int = WINDOW) -> TriangulatedTracks:
    """Join what re-matching proposes with what was there."""
    tracks = build_tracks(triangulated.keypoints, [*chain(triangulated), *match_to_landmarks(triangulated, window)], 2)
    return replace(triangulated, tracks=tracks, xyz_m=np.zeros((tracks.count, 3)))


def points_of_tracks(world: World, triangulated: TriangulatedTracks) -> list[set[int]]:
    shown = [int(world.order[f][k]) for f, k in zip(triangulated.tracks.frame, triangulated.keypoint, strict=True)]
    return [
        {shown[at] for at in np.flatnonzero(triangulated.tracks.track == track)}
        for track in range(triangulated.tracks.count)
    ]


@pytest.mark.parametrize("seed", range(3))
def test_tracks_get_back_the_observations_they_lack(seed: int) -> None:
    world, label = make_world(seed), one_label_each()
    label[np.random.default_rng(seed).random(label.shape) < 0.3] = -1
    before = world.solve(label)
    after = rebuild(before)
    assert len(before.tracks) < 0.75 * FRAMES * POINTS
    assert len(after.tracks) > 0.93 * FRAMES * POINTS
    assert all(len(points) == 1 for points in points_of_tracks(world, after))
    assert len(np.unique(np.stack([after.tracks.track, after.tracks.frame]), axis=1).T) == len(after.tracks)


@pytest.mark.parametrize("seed", range(3))
def test_two_halves_of_a_track_become_one(seed: int) -> None:
    world, label = make_world(seed), one_label_each()
    label[FRAMES // 2 :] += POINTS
    before, after = world.solve(label), rebuild(world.solve(label))
    assert (before.tracks.count, after.tracks.count) == (2 * POINTS, POINTS)
    assert sorted(points_of_tracks(world, after), key=min) == [{point} for point in range(POINTS)]
    assert len(after.tracks) == FRAMES * POINTS


def test_nothing_changes_where_nothing_lacks() -> None:
    triangulated = make_world().solve(one_label_each())
    assert match_to_landmarks(triangulated, WINDOW) == []
    assert len(rebuild(triangulated).tracks) == len(triangulated.tracks)


def lookalikes(world: World, off: BoolArray) -> tuple[World, IntArray]:
    """Take each point's keypoint in the middle frame out of its track; move some of them far, looks and all."""
    middle = FRAMES // 2
    frame, label = world.keypoints[middle], one_label_each()
    label[middle] = -1
    moved = keypoints_at(
        frame.range_m + np.where(off[world.order[middle]], 0.5, 0), frame.bearing_rad, frame.descriptors
    )
    keypoints = [moved if number == middle else other for number, other in enumerate(world.keypoints)]
    return replace(world, keypoints=keypoints), label


def test_a_keypoint_far_from_where_it_should_be_never_joins() -> None:
    off = np.arange(POINTS) < 25
    world, label = lookalikes(make_world(), off)
    found = [world.points_of(match) for match in match_to_landmarks(world.solve(label), WINDOW)]
    a, b = (np.concatenate(side) for side in zip(*found, strict=True))
    np.testing.assert_array_equal(a, b)
    assert not off[a].any() and len(a) > 0.85 * np.sum(~off)


def test_an_observation_off_its_point_disagrees_and_vouches_for_nothing() -> None:
    off = np.arange(POINTS) < 25
    world, _ = lookalikes(make_world(), off)
    triangulated = world.solve(one_label_each())
    wrong = (triangulated.tracks.frame == FRAMES // 2) & off[triangulated.tracks.track]
    np.testing.assert_array_equal(triangulated.inlier[wrong], False)
    assert triangulated.inlier[~wrong].mean() > 0.98
    label = one_label_each()
    label[FRAMES // 2 + 1] = -1
    predicted = predict_observations(world.solve(label), FRAMES // 2 + 1, 1)
    before, after = (world.solve(label).tracks.frame[predicted.nearest] == FRAMES // 2 + step for step in (0, 2))
    np.testing.assert_array_equal(before | after, True)
    assert not before[off[predicted.track]].any() and before[~off[predicted.track]].mean() > 0.9


def test_a_keypoint_that_looks_different_never_joins() -> None:
    world, label = lookalikes(make_world(), np.zeros(POINTS, dtype=bool))
    middle = FRAMES // 2
    strange = np.random.default_rng(9).integers(0, 256, (POINTS, 61), dtype=np.uint8)
    keypoints = list(world.keypoints)
    keypoints[middle] = replace(keypoints[middle], descriptors=strange)
    assert match_to_landmarks(replace(world, keypoints=keypoints).solve(label), WINDOW) == []


def test_points_one_above_the_other_do_not_merge_where_a_frame_sees_them_as_one() -> None:
    """Their keypoints coincide in that frame and look alike; only the points that the other frames tell lie apart."""
    world, half = make_world(noise=0.1), FRAMES // 2
    local = np.array([back_project(np.array(5.0), np.array(0.1), elevation) for elevation in (0.08, -0.08)])
    pair = transform(world.world_from_sonar[half], local)
    keypoints = []
    for number, (frame, shown) in enumerate(zip(world.keypoints, world.order, strict=True)):
        range_m, bearing_rad = frame.range_m.copy(), frame.bearing_rad.copy()
        seen = project(transform(invert(world.world_from_sonar[number]), pair))
        for point in (0, 1):
            at = int(np.flatnonzero(shown == point)[0])
            range_m[at], bearing_rad[at] = seen[0][point], seen[1][point]
        keypoints.append(keypoints_at(range_m, bearing_rad, frame.descriptors))
        keypoints[-1].descriptors[shown == 1] = keypoints[-1].descriptors[shown == 0]
    label = one_label_each()
    label[half:, 0], label[:half, 1] = -1, -1  # point 0 is seen before that frame, point 1 in it and later
    apart = replace(world, keypoints=keypoints, xyz_m=np.concatenate([pair, world.xyz_m[2:]]))
    triangulated = apart.solve(label)
    assert predict_observations(triangulated, half, WINDOW).track.tolist() == [0]
    pairs = np.concatenate(
        [np.stack(apart.points_of(match), axis=1) for match in match_to_landmarks(triangulated, WINDOW)]
    )
    assert [0, 0] in pairs.tolist() and [1, 1] in pairs.tolist()
    assert not {(0, 1), (1, 0)} & {(int(one), int(other)) for one, other in pairs}


def test_tracks_grow_no_further_than_the_window() -> None:
    label = one_label_each()
    label[3:] = -1
    world = make_world()
    for window in (0, 2, 5):
        found = match_to_landmarks(world.solve(label), window)
        assert {match.frame_b for match in found} == set(range(3, min(3 + window, FRAMES)))
        assert all(match.frame_b - match.frame_a <= window for match in found)


def test_what_is_known_is_not_added_again() -> None:
    label = one_label_each()
    label[4] = -1
    found = match_to_landmarks(make_world().solve(label), WINDOW)
    once = add_matches([], found)
    count = sum(len(match) for match in once)
    assert 0.85 * POINTS < count <= POINTS
    assert add_matches(once, found) == once
    part = [replace(match, index=match.index[1:], cost=match.cost[1:]) for match in found]
    assert sum(len(match) for match in add_matches(part, found)) == count


def test_nothing_known_proposes_nothing() -> None:
    world = make_world()
    triangulated = world.solve(one_label_each())
    none = np.zeros(0, dtype=np.int64)
    nothing = Tracks(none, none, np.zeros(0), np.zeros(0), keypoint=none)
    assert (
        match_to_landmarks(
            replace(triangulated, tracks=nothing, xyz_m=np.zeros((0, 3)), has_point=np.zeros(0, dtype=bool)), WINDOW
        )
        == []
    )
    label = one_label_each()
    label[4] = -1
    unknown = np.zeros(POINTS, dtype=bool)
    assert match_to_landmarks(replace(world.solve(label), has_point=unknown), WINDOW) == []
    empty = keypoints_at(np.zeros(0), np.zeros(0), np.zeros((0, 61), dtype=np.uint8))
    keypoints = [empty if number == 4 else frame for number, frame in enumerate(world.keypoints)]
    assert match_to_landmarks(replace(world.solve(label), keypoints=keypoints), WINDOW) == []


def test_sigmas_are_those_of_the_new_keypoint() -> None:
    label = one_label_each()
    label[4] = -1
    triangulated = make_world().solve(label)
    stated = replace(triangulated.tracks, sigma=np.tile([0.05, 0.02], (len(triangulated.tracks), 1)))
    found = match_to_landmarks(replace(triangulated, tracks=stated), WINDOW)
    assert found and match_to_landmarks(triangulated, WINDOW)[0].sigma is None
    for match in found:
        assert match.sigma is not None
        np.testing.assert_allclose(match.sigma, np.tile(triangulated.default_sigma, (len(match), 1)))


def test_predictions_lie_where_points_are_seen_and_as_surely_as_stated() -> None:
    label = one_label_each()
    label[4] = -1
    squares = []
    for seed in range(4):
        world = make_world(seed, noise=0.0)
        predicted = predict_observations(world.solve(label), 4, WINDOW)
        frame, at = world.keypoints[4], np.argsort(world.order[4])
        np.testing.assert_allclose(predicted.range_m, frame.range_m[at], atol=1e-9)
        np.testing.assert_allclose(predicted.bearing_rad, frame.bearing_rad[at], atol=1e-9)
        squares.append(np.sqrt(predicted.covariance[:, 0, 0]) / feature_sigma(SONAR, CONFIG.noise)[0])
    assert 0.1 < float(np.median(squares)) < 1.2, "seven or eight views tell a point better than one"
