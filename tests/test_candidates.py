"""Candidate matches: which pairs of frames, and what the structural-and-spatial loss leaves of them."""

import numpy as np
import pytest

from asfm.config import Config, MatchingConfig, SslConfig
from asfm.frontend.candidates import match_frames, match_with_previous
from asfm.frontend.matching import match_keypoints
from asfm.frontend.ssl import structural_spatial_loss
from asfm.types import IntArray, Keypoints

COUNT, WIDTH = 30, 15


def sight(seed: int, order_seed: int, torn: tuple[int, ...] = ()) -> Keypoints:
    """The scene's features in an order of their own; of the torn ones the squares show something else."""
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
    squares = np.zeros((0, WIDTH, WIDTH), dtype=np.float32)
    return Keypoints(np.zeros((0, 2)), none, none, none, np.zeros((0, 61), dtype=np.uint8), squares)


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
        pairs = [(match.frame_a, match.frame_b) for match in match_with_previous(frame, keypoints, config)]
        assert pairs == [(frame - gap, frame) for gap in range(1, min(max_gap, frame) + 1)]


def test_later_frames_need_not_be_there_yet() -> None:
    assert len(match_with_previous(1, [sight(0, 0), sight(0, 1)], Config())) == 1


def test_frames_without_keypoints_have_empty_matches() -> None:
    keypoints = [sight(0, 0), nothing_seen(), nothing_seen()]
    for a, b in ((0, 1), (1, 2)):
        found = match_frames(a, b, keypoints, Config())
        assert (len(found), found.index.shape, found.cost.shape) == (0, (0, 2), (0,))


def test_other_scenes_share_next_to_nothing() -> None:
    assert len(match_frames(0, 1, [sight(0, 1), sight(7, 2)], Config())) == 0
