"""Data association on random points observed from known poses: correct matches are kept, wrong ones rejected."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.config import Config, MatchingConfig, TracksConfig
from asfm.frontend.tracking.association import associate
from asfm.frontend.tracking.track_builder import build_tracks
from asfm.geometry.feature_noise import feature_sigma
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import SonarModel, back_project, project
from asfm.types import FloatArray, Keypoints, Matches, Tracks
from tests.worlds import make_keypoints

SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.7, 0.7), (600, 256), 0.35)
CONFIG = Config()
FRAMES, POINTS = 8, 60


@dataclass(frozen=True)
class World:
    """Poses, the keypoints of every frame and the points they show."""

    world_from_sonar: FloatArray
    keypoints: list[Keypoints]
    point: list[list[int]]
    """Number of the point behind each keypoint of each frame."""

    def matches(self, a: int, b: int, wrong: int, rng: np.random.Generator) -> Matches:
        """Return all correct matches of two frames and some wrong ones, which cost less."""
        true = [
            (self.point[a].index(point), self.point[b].index(point))
            for point in set(self.point[a]) & set(self.point[b])
        ]
        pairs = np.array(sorted(true), dtype=np.int64).reshape(-1, 2)
        swapped = rng.integers(0, (len(self.point[a]), len(self.point[b])), (wrong, 2))
        cost = np.concatenate([rng.uniform(0.5, 1.0, len(pairs)), rng.uniform(0.0, 0.5, wrong)])
        return Matches(a, b, np.concatenate([pairs, swapped]), cost)

    def all_matches(self, wrong: int, rng: np.random.Generator) -> list[Matches]:
        return [self.matches(a, b, wrong, rng) for b in range(FRAMES) for a in range(max(0, b - 4), b)]

    def points_of(self, tracks: Tracks) -> list[set[int]]:
        """Return the set of points that the observations of each track show."""
        found: list[set[int]] = [set() for _ in range(tracks.count)]
        for track, frame, range_m in zip(tracks.track, tracks.frame, tracks.range_m, strict=True):
            (keypoint,) = np.flatnonzero(self.keypoints[frame].range_m == range_m)
            found[track].add(self.point[frame][keypoint])
        return found


def make_world(seed: int = 0, noise: float = 0.5) -> World:
    """Make a scene to port of a path that goes forward, to port and up while it turns: an asymmetric scene."""
    rng = np.random.default_rng(seed)
    step = np.arange(FRAMES)[:, None]
    xyz_m = step * np.array([0.08, 0.12, 0.03]) + rng.normal(scale=0.02, size=(FRAMES, 3))
    turn_rad = step * np.array([0.02, -0.01, 0.03])
    poses = make_pose(xyz_m, Rotation.from_rotvec(turn_rad))
    points = back_project(rng.uniform(2, 9, POINTS), rng.uniform(0.0, 0.6, POINTS), rng.uniform(-0.12, 0.12, POINTS))
    sigma = noise * feature_sigma(SONAR, CONFIG.noise)
    keypoints, shown = [], []
    for pose in poses:
        local = transform(invert(pose), points)
        seen = np.flatnonzero(SONAR.sees(local))
        rng.shuffle(seen)
        range_m, bearing_rad, _ = project(local[seen])
        range_m, bearing_rad = (
            value + rng.normal(scale=scale, size=len(seen))
            for value, scale in zip((range_m, bearing_rad), sigma, strict=True)
        )
        shown.append(seen.tolist())
        keypoints.append(make_keypoints(range_m, bearing_rad, sonar=SONAR))
    return World(poses, keypoints, shown)


def impure_share(world: World, tracks: Tracks) -> float:
    """Return the share of tracks with observations of more than one point."""
    points = world.points_of(tracks)
    return sum(len(shown) > 1 for shown in points) / max(len(points), 1)


def test_correct_matches_are_all_kept() -> None:
    world = make_world()
    tracks = associate(
        world.keypoints, world.all_matches(0, np.random.default_rng(1)), SONAR, world.world_from_sonar, CONFIG
    )
    assert impure_share(world, tracks) == 0
    expected = [point for point in range(POINTS) if sum(point in points for points in world.point) >= 3]
    assert len(expected) > 40
    assert sorted(point for points in world.points_of(tracks) for point in points) == expected
    assert len(tracks) == sum(point in points for point in expected for points in world.point)


@pytest.mark.parametrize("seed", range(3))
def test_wrong_matches_are_rejected_though_they_cost_less(seed: int) -> None:
    world = make_world(seed)
    candidates = world.all_matches(15, np.random.default_rng(seed))
    kept = associate(world.keypoints, candidates, SONAR, world.world_from_sonar, CONFIG)
    assert impure_share(world, build_tracks(world.keypoints, candidates, 3)) > 0.5, "without the gate"
    assert impure_share(world, kept) < 0.1
    pure = {point for points in world.points_of(kept) if len(points) == 1 for point in points}
    assert len(pure) > 0.85 * POINTS


def test_a_mirrored_bearing_axis_loses_most_matches() -> None:
    world = make_world()
    mirrored = [make_keypoints(frame.range_m, -frame.bearing_rad, sonar=SONAR) for frame in world.keypoints]
    candidates = world.all_matches(0, np.random.default_rng(1))
    config = Config(tracks=TracksConfig(gate_factor=1e-3))
    right = associate(world.keypoints, candidates, SONAR, world.world_from_sonar, config)
    wrong = associate(mirrored, candidates, SONAR, world.world_from_sonar, config)
    assert len(wrong) < 0.5 * len(right)


def test_the_gate_adapts_to_pose_errors() -> None:
    """Under drifted poses all matches are off their arcs: a gate of fixed width loses them, the default does not."""
    world = make_world()
    drift = make_pose(
        np.arange(FRAMES)[:, None] * np.array([0.05, -0.05, 0.0]),
        Rotation.from_rotvec(np.arange(FRAMES)[:, None] * np.array([0.0, 0.0, 0.02])),
    )
    candidates = world.all_matches(0, np.random.default_rng(1))
    adaptive = associate(world.keypoints, candidates, SONAR, world.world_from_sonar @ drift, CONFIG)
    fixed_gate = Config(tracks=TracksConfig(gate_factor=1e-3))
    fixed = associate(world.keypoints, candidates, SONAR, world.world_from_sonar @ drift, fixed_gate)
    best = associate(world.keypoints, candidates, SONAR, world.world_from_sonar, CONFIG)
    assert len(adaptive) > 0.9 * len(best)
    assert len(fixed) < 0.75 * len(best)


def test_tracks_are_invariant_to_the_world_frame() -> None:
    world = make_world()
    elsewhere = make_pose(np.array([30.0, -20.0, 5.0]), Rotation.from_rotvec([0.3, -0.5, 2.0]))
    candidates = world.all_matches(10, np.random.default_rng(1))
    here = associate(world.keypoints, candidates, SONAR, world.world_from_sonar, CONFIG)
    there = associate(world.keypoints, candidates, SONAR, elsewhere @ world.world_from_sonar, CONFIG)
    np.testing.assert_array_equal(here.track, there.track)
    np.testing.assert_array_equal(here.range_m, there.range_m)


def test_no_matches_give_no_tracks() -> None:
    world = make_world()
    empty = Matches(0, 1, np.zeros((0, 2), dtype=np.int64), np.zeros(0))
    for candidates in ([], [empty]):
        tracks = associate(world.keypoints, candidates, SONAR, world.world_from_sonar, CONFIG)
        assert (len(tracks), tracks.count) == (0, 0)


def test_tracks_have_at_least_min_views() -> None:
    world = make_world()
    candidates = world.all_matches(0, np.random.default_rng(1))
    for min_views in (2, 5):
        config = Config(tracks=TracksConfig(min_views=min_views))
        tracks = associate(world.keypoints, candidates, SONAR, world.world_from_sonar, config)
        assert np.bincount(tracks.track).min() >= min_views


def see_ahead(range_m: list[list[float]]) -> tuple[list[Keypoints], FloatArray]:
    """Make the keypoints and poses of a sonar at rest that sees points straight ahead, at each frame's ranges."""
    keypoints = [make_keypoints(np.array(ranges), np.zeros(len(ranges)), sonar=SONAR) for ranges in range_m]
    return keypoints, np.tile(np.eye(4), (len(range_m), 1, 1))


NARROW_GATE = Config(tracks=TracksConfig(gate_factor=1e-3, min_gate=2.0, min_views=2))


@pytest.mark.parametrize(("sigmas", "kept"), [(1.9, 1), (2.1, 0)])
def test_the_gate_is_in_sigmas_of_the_difference_of_two_features(sigmas: float, kept: int) -> None:
    difference_m = sigmas * np.sqrt(2) * float(feature_sigma(SONAR, CONFIG.noise)[0])
    keypoints, poses = see_ahead([[5.0], [5.0 + difference_m]])
    candidates = [Matches(0, 1, np.zeros((1, 2), dtype=np.int64), np.zeros(1))]
    assert associate(keypoints, candidates, SONAR, poses, NARROW_GATE).count == kept


def test_of_two_matches_of_one_keypoint_the_one_nearer_to_its_arc_is_used() -> None:
    """Their costs alone prefer the other one, by less than the distances say."""
    sigma_m = np.sqrt(2) * float(feature_sigma(SONAR, CONFIG.noise)[0])
    keypoints, poses = see_ahead([[5.0, 5.0 + 1.6 * sigma_m], [5.0]])
    candidates = [Matches(0, 1, np.array([[0, 0], [1, 0]]), np.array([0.55, 0.5]))]
    tracks = associate(keypoints, candidates, SONAR, poses, NARROW_GATE)
    np.testing.assert_array_equal(tracks.range_m, [5.0, 5.0])


def test_a_wrong_loop_does_not_set_the_gate_of_its_own_gap() -> None:
    """Three loops of other gaps fit the poses: all loops share their gate."""
    world, rng = make_world(), np.random.default_rng(3)
    config = Config(matching=MatchingConfig(max_gap=2))
    near = [world.matches(a, a + 1, 0, rng) for a in range(FRAMES - 1)]
    loops = [world.matches(a, b, 0, rng) for a, b in ((0, 4), (0, 6), (0, 7))]
    wrong = world.matches(0, 5, 40, rng)
    wrong = Matches(0, 5, wrong.index[-40:], wrong.cost[-40:])
    tracks = associate(world.keypoints, [*near, *loops, wrong], SONAR, world.world_from_sonar, config)
    assert np.mean([len(points) == 1 for points in world.points_of(tracks)]) > 0.95
