"""Loop verification on scenes with known associations: correct loops pass, repetitive and similar places do not."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.config import Config
from asfm.frontend.loops.keypoint_tracks import KeypointTracks
from asfm.frontend.loops.loop_check import LoopCheck, are_mutually_consistent
from asfm.frontend.loops.loop_verification import arc_inlier_ratio, verify_loop
from asfm.frontend.matching.pair_matching import match_pairs
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import SonarModel, project
from asfm.navigation.pose_prediction import PosePrediction
from asfm.types import FloatArray, IntArray, Keypoints, Matches, Tracks
from tests.worlds import B_FROM_A, MATCHING_SONAR, make_frame_pair, make_keypoints

SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.6, 0.6), (600, 256), np.deg2rad(20))
CONFIG = Config()
WIDTH = 2 * CONFIG.patch_radius_px + 1
NONE = np.zeros(0, dtype=np.int64)
NO_TRACKS = Tracks(NONE, NONE, np.zeros(0), np.zeros(0), keypoint=NONE)


@dataclass(frozen=True)
class Scene:
    """Points with their appearance: points of equal appearance have the same descriptor and patch, up to noise."""

    xyz_m: FloatArray
    appearance: IntArray


@dataclass(frozen=True)
class Observation:
    """One frame of a scene."""

    keypoints: Keypoints
    point: IntArray
    """(K,) point of the scene behind each keypoint; -1 for clutter."""


def observe(scene: Scene, world_from_sonar: FloatArray, rng: np.random.Generator, clutter: int = 40) -> Observation:
    """Detect most points in the frustum, with noise of position, descriptor and patch, among clutter."""
    in_sonar = transform(invert(world_from_sonar), scene.xyz_m)
    point = np.flatnonzero(SONAR.sees(in_sonar) & (rng.random(len(in_sonar)) < 0.7))
    range_m, bearing_rad, _ = project(in_sonar[point])
    range_m = np.concatenate([range_m + rng.normal(0, 0.015, len(point)), rng.uniform(1, 9.5, clutter)])
    bearing_rad = np.concatenate([bearing_rad + rng.normal(0, 0.004, len(point)), rng.uniform(-0.6, 0.6, clutter)])
    sources = [np.random.default_rng(1000 + kind) for kind in scene.appearance[point].tolist()] + [rng] * clutter
    descriptors = np.stack([source.integers(0, 256, 61, dtype=np.uint8) for source in sources])
    patches = np.stack([source.random((WIDTH, WIDTH), np.float32) for source in sources])
    descriptors = descriptors ^ np.packbits(rng.random((len(sources), 488)) < 0.08, axis=1)
    patches = patches + 0.1 * rng.random(patches.shape, np.float32)
    keypoints = make_keypoints(range_m, bearing_rad, descriptors, patches, SONAR)
    return Observation(keypoints, np.concatenate([point, np.full(clutter, -1)]))


def make_random_scene(rng: np.random.Generator, count: int = 300) -> Scene:
    """Make points of distinct appearance on a bottom of 24 m by 24 m."""
    return Scene(rng.uniform([-12, -12, -0.3], [12, 12, 0.3], (count, 3)), np.arange(count))


def make_row_of_piles(rng: np.random.Generator, spacing_m: float, distinct: int = 0) -> Scene:
    """Make a row of equal piles along y, each of the same 40 points, and some points of distinct appearance."""
    pile = rng.uniform([-0.3, -0.3, -0.3], [0.3, 0.3, 0.3], (40, 3)) + np.array([5.0, 0.0, 0.0])
    places = spacing_m * np.arange(-8, 9)
    piles = (pile[None] + places[:, None, None] * np.array([0.0, 1.0, 0.0])).reshape(-1, 3)
    ground = rng.uniform([3, -10, -0.3], [9, 10, 0.3], (distinct, 3))
    appearance = np.concatenate([np.tile(np.arange(40), len(places)), 100 + np.arange(distinct)])
    return Scene(np.concatenate([piles, ground]), appearance)


def pose_at(y_m: float, yaw_rad: float = 0.0) -> FloatArray:
    return make_pose(np.array([0.0, y_m, 0.0]), Rotation.from_euler("z", yaw_rad))


def verify(
    observations: list[Observation],
    predicted_poses: FloatArray,
    sigma_m: float,
    sigma_rad: float,
    tracks: Tracks = NO_TRACKS,
) -> tuple[LoopCheck, float]:
    """Match and verify frames 0 and 1; return the check and the share of correct matches."""
    keypoints = [frame.keypoints for frame in observations]
    predicted = PosePrediction(predicted_poses, sigma_rad, sigma_m)
    (matches,) = match_pairs([(0, 1)], keypoints, CONFIG, SONAR, predicted)
    tracked = KeypointTracks(tracks, keypoints, SONAR, CONFIG.noise, np.ones(len(tracks), dtype=bool))
    check = verify_loop(matches, keypoints, SONAR, predicted, tracked, CONFIG)
    a, b = (frame.point[which] for frame, which in zip(observations[:2], check.matches.index.T, strict=True))
    return check, float(np.mean((a == b) & (a >= 0))) if len(a) else 0.0


@pytest.mark.parametrize("seed", range(4))
def test_a_revisited_place_is_accepted_with_the_error_of_the_prediction(seed: int) -> None:
    """The prediction is wrong by 0.3 m, within its stated uncertainty; the check estimates that error."""
    rng = np.random.default_rng(seed)
    scene, poses = make_random_scene(rng), [pose_at(0.0), pose_at(0.5, 0.1)]
    observations = [observe(scene, pose, rng) for pose in poses]
    check, correct = verify(observations, np.stack([pose_at(0.0), pose_at(0.8, 0.1)]), 0.2, 0.03)
    assert check.accepted and len(check.matches) >= CONFIG.loops.min_matches
    assert correct > 0.95
    np.testing.assert_allclose(check.shift_m, [0.0, -0.3], atol=0.1)


@pytest.mark.parametrize("seed", range(4))
def test_two_different_places_are_rejected(seed: int) -> None:
    rng = np.random.default_rng(seed)
    observations = [
        observe(make_random_scene(rng), pose_at(0.0), rng),
        observe(make_random_scene(rng), pose_at(0.0), rng),
    ]
    observations[1] = Observation(_change_appearance(observations[1].keypoints, rng), observations[1].point)
    check, _ = verify(observations, np.stack([pose_at(0.0), pose_at(0.0)]), 1.0, 0.2)
    assert not check.accepted


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("spacing_m", [1.0, 1.8])
@pytest.mark.parametrize("sigma_m", [0.2, 0.6, 2.0])
def test_a_row_of_equal_piles_alone_is_rejected(seed: int, spacing_m: float, sigma_m: float) -> None:
    """The odometry is wrong by one spacing, so that the wrong piles are where the correct ones are predicted."""
    rng = np.random.default_rng(seed)
    scene = make_row_of_piles(rng, spacing_m)
    observations = [observe(scene, pose_at(0.0), rng), observe(scene, pose_at(0.3), rng)]
    check, _ = verify(observations, np.stack([pose_at(0.0), pose_at(0.3 + spacing_m)]), sigma_m, 0.02)
    assert not check.accepted


@pytest.mark.parametrize("seed", range(3))
def test_equal_piles_among_distinct_points_give_the_correct_loop(seed: int) -> None:
    """The same wrong odometry with a large sigma: the points around the piles decide."""
    rng = np.random.default_rng(seed)
    scene = make_row_of_piles(rng, 1.8, distinct=250)
    observations = [observe(scene, pose_at(0.0), rng), observe(scene, pose_at(0.3), rng)]
    check, correct = verify(observations, np.stack([pose_at(0.0), pose_at(0.3 + 1.8)]), 2.0, 0.02)
    assert check.accepted and correct > 0.95
    np.testing.assert_allclose(check.shift_m, [0.0, -1.8], atol=0.1)


@pytest.mark.parametrize("seed", range(3))
def test_two_equal_piles_observed_apart_in_one_frame_are_rejected(seed: int) -> None:
    """Frames 0 and 1 observe one of two equal piles each, frame 2 both: its tracks contradict the loop."""
    rng = np.random.default_rng(seed)
    scene = make_row_of_piles(rng, 4.2)
    observations = [observe(scene, pose_at(y_m), rng, clutter=0) for y_m in (0.0, 4.2, 2.1)]
    predicted = np.stack([pose_at(0.0), pose_at(0.0), pose_at(2.1)])
    alone, correct = verify(observations, predicted, 0.3, 0.02)
    assert alone.accepted and correct == 0.0, "the two frames alone do not contradict it"
    tracked, _ = verify(observations, predicted, 0.3, 0.02, _track(observations))
    assert tracked.reason == "conflicts"


@pytest.mark.parametrize("bare", [0, 1])
def test_the_frame_that_is_covered_less_decides(bare: int) -> None:
    """A pile and marks at the edges of the view match; one frame shows other ground between them, one bare ground."""
    rng = np.random.default_rng(0)
    pile, marks = rng.uniform([4.6, -0.4, -0.2], [5.4, 0.4, 0.2], (70, 3)), [[2.0, 1.2, 0.0], [2.0, -1.2, 0.0]]
    far = np.repeat([[8.0, 4.8, 0.0], [8.0, -4.8, 0.0], *marks], 3, axis=0) + rng.normal(0, 0.1, (12, 3))
    common, ground = np.concatenate([pile, far]), rng.uniform([2, -5, -0.3], [8, 5, 0.3], (400, 3))
    scenes = [Scene(common, np.arange(82)), Scene(np.concatenate([common, ground]), np.arange(482))]
    frames = scenes if bare == 0 else scenes[::-1]
    observations = [observe(scene, pose_at(0.0), rng, clutter=0) for scene in frames]
    check, _ = verify(observations, np.stack([pose_at(0.0), pose_at(0.0)]), 0.3, 0.02)
    assert check.reason == "coverage"


@pytest.mark.parametrize("seed", range(3))
def test_equal_objects_on_different_ground_are_rejected(seed: int) -> None:
    """The piles match, and nothing around them does."""
    rng = np.random.default_rng(seed)
    scene = make_row_of_piles(rng, 6.0, distinct=250)
    observations = [observe(scene, pose_at(0.0), rng), observe(scene, pose_at(6.0), rng)]
    check, correct = verify(observations, np.stack([pose_at(0.0), pose_at(0.0)]), 0.3, 0.02)
    assert check.reason == "coverage" and correct == 0.0
    again, correct = verify(
        [observations[0], observe(scene, pose_at(0.2), rng)], np.stack([pose_at(0.0), pose_at(0.0)]), 0.3, 0.02
    )
    assert again.accepted and correct > 0.95


def test_an_ambiguous_scene_is_rejected_under_an_uncertain_prediction() -> None:
    """The correct association is possible, but so is that with the neighbouring piles."""
    rng = np.random.default_rng(0)
    scene = make_row_of_piles(rng, 1.0)
    observations = [observe(scene, pose_at(0.0), rng, 0), observe(scene, pose_at(0.0), rng, 0)]
    check, _ = verify(observations, np.stack([pose_at(0.0), pose_at(0.0)]), 1.0, 0.02)
    assert not check.accepted


def test_neighbouring_loops_with_the_same_pose_error_are_consistent() -> None:
    rng = np.random.default_rng(1)
    scene = make_random_scene(rng)
    observations = [observe(scene, pose_at(0.0), rng), observe(scene, pose_at(0.5), rng)]
    first, _ = verify(observations, np.stack([pose_at(0.0), pose_at(0.7)]), 0.2, 0.03)
    same, _ = verify(observations, np.stack([pose_at(0.0), pose_at(0.7)]), 0.2, 0.03)
    other, _ = verify(observations, np.stack([pose_at(0.0), pose_at(-0.2)]), 0.4, 0.03)
    assert first.accepted and other.accepted
    assert not are_mutually_consistent(first, same, 8), "the same pair"
    assert are_mutually_consistent(first, _at_frames(same, 1, 2), 8)
    assert not are_mutually_consistent(first, _at_frames(same, 1, 20), 8)
    assert not are_mutually_consistent(first, _at_frames(other, 1, 2), 8)


def test_arc_inlier_ratio_is_the_share_of_correct_matches_under_true_poses() -> None:
    pair, sigma = make_frame_pair(count=60, wrong=12), np.array([0.01, 0.005])
    matches = Matches(0, 1, pair.index, np.zeros(60))
    poses = np.stack([np.eye(4), invert(B_FROM_A)])

    def ratio(matches: Matches, gate: float) -> float:
        return arc_inlier_ratio(matches, [pair.keypoints_a, pair.keypoints_b], MATCHING_SONAR, poses, sigma, gate)

    assert 48 / 60 <= ratio(matches, 3.0) <= 50 / 60
    assert ratio(replace(matches, index=pair.index[12:]), 1.0) == 1.0
    assert ratio(matches, 1e9) == 1.0
    assert ratio(replace(matches, index=pair.index[:0]), 3.0) == 0.0


def _at_frames(check: LoopCheck, frame_a: int, frame_b: int) -> LoopCheck:
    return replace(check, matches=replace(check.matches, frame_a=frame_a, frame_b=frame_b))


def _change_appearance(keypoints: Keypoints, rng: np.random.Generator) -> Keypoints:
    descriptors = rng.integers(0, 256, keypoints.descriptors.shape, dtype=np.uint8)
    return replace(keypoints, descriptors=descriptors, patches=rng.random(keypoints.patches.shape, np.float32))


def _track(observations: list[Observation]) -> Tracks:
    """Join the observations of each point over all frames into a track."""
    frame = np.repeat(np.arange(len(observations)), [len(each.point) for each in observations])
    point = np.concatenate([each.point for each in observations])
    pixels = [
        np.concatenate([getattr(each.keypoints, name) for each in observations]) for name in ("range_m", "bearing_rad")
    ]
    order = np.lexsort((frame, point))
    order = order[point[order] >= 0]
    _, track = np.unique(point[order], return_inverse=True)
    keypoint = np.concatenate([np.arange(len(each.point)) for each in observations])
    range_m, bearing_rad = (value[order] for value in pixels)
    return Tracks(track.astype(np.int64), frame[order], range_m, bearing_rad, keypoint=keypoint[order])
