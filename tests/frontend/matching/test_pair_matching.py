"""Candidate matches: which pairs of frames, and what the structural-and-spatial loss leaves of them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.config import Config, MatchingConfig, SslConfig
from asfm.frontend.matching.nearest import match_keypoints
from asfm.frontend.matching.pair_matching import match_pairs, match_with_previous
from asfm.frontend.matching.ssl import structural_spatial_loss
from asfm.geometry.poses import make_pose, transform
from asfm.geometry.sonar import SonarModel, back_project, project
from asfm.navigation.pose_prediction import PosePrediction
from asfm.types import FloatArray, IntArray, Keypoints, Matches

COUNT, WIDTH = 30, 15
SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.7, 0.7), (600, 256), 0.2)


def match_frames(
    a: int, b: int, keypoints: list[Keypoints], config: Config, predicted: PosePrediction | None = None
) -> Matches:
    return match_pairs([(a, b)], keypoints, config, SONAR, predicted)[0]


def sight(seed: int, order_seed: int, torn: tuple[int, ...] = ()) -> Keypoints:
    """The scene's features in an order of their own; of the torn ones the patches show something else."""
    scene, own = np.random.default_rng(seed), np.random.default_rng(order_seed)
    descriptors = scene.integers(0, 256, (COUNT, 61), dtype=np.uint8)
    patches = scene.random((COUNT, WIDTH, WIDTH)).astype(np.float32)
    patches += 0.05 * own.random(patches.shape, np.float32)
    patches[list(torn)] = own.random((len(torn), WIDTH, WIDTH)).astype(np.float32)
    order = own.permutation(COUNT)
    name = order.astype(float)
    noisy = descriptors ^ np.packbits(own.random((COUNT, 488)) < 0.05, axis=1)
    return Keypoints(np.zeros((COUNT, 2)), name, -name, np.ones(COUNT), noisy[order], patches[order])


def nothing_seen() -> Keypoints:
    none = np.zeros(0)
    patches = np.zeros((0, WIDTH, WIDTH), dtype=np.float32)
    return Keypoints(np.zeros((0, 2)), none, none, none, np.zeros((0, 61), dtype=np.uint8), patches)


def names(keypoints: Keypoints, index: IntArray) -> list[int]:
    return [int(name) for name in keypoints.range_m[index]]


def test_the_same_scene_is_matched_whole() -> None:
    keypoints = [sight(0, 1), sight(0, 2)]
    found = match_frames(0, 1, keypoints, Config())
    assert (found.frame_a, found.frame_b, len(found)) == (0, 1, COUNT)
    assert names(keypoints[0], found.index[:, 0]) == names(keypoints[1], found.index[:, 1])


def test_what_looks_different_is_left_out() -> None:
    torn = (3, 11, 20)
    keypoints = [sight(0, 1), sight(0, 2, torn)]
    found = match_frames(0, 1, keypoints, Config())
    assert sorted(names(keypoints[0], found.index[:, 0])) == sorted(set(range(COUNT)) - set(torn))
    everything = match_frames(0, 1, keypoints, Config(ssl=SslConfig(max_loss=1e6)))
    assert len(everything) == COUNT


def test_cost_is_the_ratio_and_the_loss() -> None:
    config = Config()
    keypoints = [sight(0, 1), sight(0, 2, (5, 6))]
    index, ratio = match_keypoints(keypoints[0], keypoints[1], config.matching)
    loss = structural_spatial_loss(keypoints[0].patches[index[:, 0]], keypoints[1].patches[index[:, 1]], config.ssl)
    assert loss.min() > 1e-3
    cost = {tuple(pair): value for pair, value in zip(index.tolist(), ratio + loss, strict=True)}
    found = match_frames(0, 1, keypoints, config)
    assert found.cost.tolist() == [cost[tuple(pair)] for pair in found.index.tolist()]
    assert len(found.cost) == len(found) == (loss <= config.ssl.max_loss).sum()


@pytest.mark.parametrize("max_gap", [1, 3, 50])
def test_each_frame_meets_those_before_it_nearest_first(max_gap: int) -> None:
    config = Config(matching=MatchingConfig(max_gap=max_gap))
    keypoints = [sight(0, order) for order in range(6)]
    for frame in range(6):
        pairs = [(match.frame_a, match.frame_b) for match in match_with_previous(frame, keypoints, config, SONAR)]
        assert pairs == [(frame - gap, frame) for gap in range(1, min(max_gap, frame) + 1)]


def test_later_frames_need_not_be_there_yet() -> None:
    assert len(match_with_previous(1, [sight(0, 0), sight(0, 1)], Config(), SONAR)) == 1


def test_frames_without_keypoints_have_empty_matches() -> None:
    keypoints = [sight(0, 0), nothing_seen(), nothing_seen()]
    for a, b in ((0, 1), (1, 2)):
        found = match_frames(a, b, keypoints, Config())
        assert (len(found), found.index.shape, found.cost.shape) == (0, (0, 2), (0,))


def test_other_scenes_share_next_to_nothing() -> None:
    assert len(match_frames(0, 1, [sight(0, 1), sight(7, 2)], Config())) == 0


def test_pairs_that_somebody_names_are_matched() -> None:
    keypoints = [sight(0, order) for order in range(5)]
    found = match_pairs([(0, 4), (3, 1)], keypoints, Config(), SONAR)
    assert [(match.frame_a, match.frame_b, len(match)) for match in found] == [(0, 4, COUNT), (3, 1, COUNT)]


GUIDED = Config(matching=MatchingConfig(guided=True))
B_FROM_A = make_pose(np.array([0.1, -0.2, 0.0]), Rotation.from_euler("z", 0.1))
"""Frame b's sonar is the world, so that frame a's pose is the relative one."""


def views(seed: int, alike: int) -> list[Keypoints]:
    """Points of a scene in two frames; of each some number, in other places, look alike."""
    rng = np.random.default_rng(seed)
    points = back_project(rng.uniform(2, 8, COUNT), rng.uniform(-0.5, 0.5, COUNT), rng.uniform(-0.09, 0.09, COUNT))
    descriptors = rng.integers(0, 256, (COUNT, 61), dtype=np.uint8)[np.arange(COUNT) // alike]
    patches = rng.random((COUNT, WIDTH, WIDTH)).astype(np.float32)[np.arange(COUNT) // alike]
    found = []
    for xyz_m in (points, transform(B_FROM_A, points)):
        noisy = descriptors ^ np.packbits(rng.random((COUNT, 488)) < 0.03, axis=1)
        range_m, bearing_rad, _ = project(xyz_m)
        place = np.zeros((COUNT, 2))
        found.append(Keypoints(place, range_m, bearing_rad, np.ones(COUNT), noisy, patches))
    return found


def predict(a_pose: FloatArray) -> PosePrediction:
    return PosePrediction(np.stack([a_pose, np.eye(4)]), 0.005, 0.02)


def right(matches: Matches) -> int:
    return int((matches.index[:, 0] == matches.index[:, 1]).sum())


def test_a_prediction_tells_points_apart_that_look_alike() -> None:
    keypoints = views(1, alike=3)
    free = match_frames(0, 1, keypoints, Config())
    guided = match_frames(0, 1, keypoints, GUIDED, predict(B_FROM_A))
    assert right(guided) > 0.85 * COUNT > 0.5 * COUNT > right(free)
    assert right(guided) == len(guided)


def test_a_prediction_that_the_images_contradict_is_not_believed() -> None:
    keypoints = views(2, alike=1)
    elsewhere = make_pose(np.array([1.5, 1.0, 0.0]), Rotation.from_euler("z", -0.5))
    for config in (Config(), GUIDED):
        found = match_frames(0, 1, keypoints, config, predict(elsewhere))
        assert right(found) == len(found) > 0.9 * COUNT


def test_without_guidance_what_looks_alike_is_lost() -> None:
    keypoints = views(1, alike=3)
    free = match_frames(0, 1, keypoints, Config(), predict(B_FROM_A))
    assert right(free) < 0.5 * COUNT


def test_nothing_seen_is_no_match_with_a_prediction_too() -> None:
    for pair in ([nothing_seen(), views(1, 1)[1]], [views(1, 1)[0], nothing_seen()]):
        for config in (Config(), GUIDED):
            assert len(match_frames(0, 1, pair, config, predict(B_FROM_A))) == 0


def test_many_pairs_at_once_are_matched_as_one_by_one() -> None:
    keypoints = [*views(1, 2), *views(1, 1), nothing_seen()]
    poses = np.stack([B_FROM_A, np.eye(4), B_FROM_A, np.eye(4), np.eye(4)])
    predicted = PosePrediction(poses, 0.005, 0.02)
    pairs = [(0, 1), (0, 4), (2, 3), (1, 3), (3, 0)]
    for guess in (None, predicted):
        together = match_pairs(pairs, keypoints, GUIDED, SONAR, guess)
        for (a, b), found in zip(pairs, together, strict=True):
            alone = match_frames(a, b, keypoints, GUIDED, guess)
            assert (found.frame_a, found.frame_b) == (a, b)
            for name in ("index", "cost", "rejected", "rejected_by"):
                np.testing.assert_allclose(getattr(found, name), getattr(alone, name), rtol=1e-6)


def test_the_first_frame_has_nobody_before_it() -> None:
    for guess in (None, predict(B_FROM_A)):
        assert match_with_previous(0, views(1, 1), Config(), SONAR, guess) == []
