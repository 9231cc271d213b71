"""Pair matching: which pairs of frames are matched, filtering by the loss, and guidance by predicted poses."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.config import Config, MatchingConfig, SslConfig
from asfm.frontend.matching.frame_pair import predict_arcs
from asfm.frontend.matching.nearest import match_keypoints
from asfm.frontend.matching.pair_matching import MIN_GAIN, match_pairs, match_with_previous
from asfm.frontend.matching.ssl import structural_spatial_loss
from asfm.geometry.poses import make_pose, transform
from asfm.geometry.sonar import SonarModel
from asfm.navigation.pose_prediction import PosePrediction
from asfm.types import FloatArray, IntArray, Keypoints, Matches
from tests.worlds import make_keypoints, observe_points, random_points

COUNT, WIDTH = 30, 15
SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.7, 0.7), (600, 256), 0.2)


def match_frames(
    a: int, b: int, keypoints: list[Keypoints], config: Config, predicted: PosePrediction | None = None
) -> Matches:
    return match_pairs([(a, b)], keypoints, config, SONAR, predicted)[0]


def observe(seed: int, order_seed: int, changed: tuple[int, ...] = ()) -> Keypoints:
    """Return a scene's features in random order, range being the feature's number; patches of some are changed."""
    scene, own = np.random.default_rng(seed), np.random.default_rng(order_seed)
    descriptors = scene.integers(0, 256, (COUNT, 61), dtype=np.uint8)
    patches = scene.random((COUNT, WIDTH, WIDTH)).astype(np.float32)
    patches += 0.05 * own.random(patches.shape, np.float32)
    patches[list(changed)] = own.random((len(changed), WIDTH, WIDTH)).astype(np.float32)
    order = own.permutation(COUNT)
    number = order.astype(float)
    noisy = descriptors ^ np.packbits(own.random((COUNT, 488)) < 0.05, axis=1)
    return make_keypoints(number, -number, noisy[order], patches[order])


def no_keypoints() -> Keypoints:
    return make_keypoints(np.zeros(0), np.zeros(0), patches=np.zeros((0, WIDTH, WIDTH)))


def feature_numbers(keypoints: Keypoints, index: IntArray) -> list[int]:
    return [int(number) for number in keypoints.range_m[index]]


def test_all_features_of_one_scene_are_matched() -> None:
    keypoints = [observe(0, 1), observe(0, 2)]
    found = match_frames(0, 1, keypoints, Config())
    assert (found.frame_a, found.frame_b, len(found)) == (0, 1, COUNT)
    assert feature_numbers(keypoints[0], found.index[:, 0]) == feature_numbers(keypoints[1], found.index[:, 1])


def test_matches_with_different_patches_are_rejected() -> None:
    changed = (3, 11, 20)
    keypoints = [observe(0, 1), observe(0, 2, changed)]
    found = match_frames(0, 1, keypoints, Config())
    assert sorted(feature_numbers(keypoints[0], found.index[:, 0])) == sorted(set(range(COUNT)) - set(changed))
    everything = match_frames(0, 1, keypoints, Config(ssl=SslConfig(max_loss=1e6)))
    assert len(everything) == COUNT


def test_cost_is_ratio_plus_loss() -> None:
    config = Config()
    keypoints = [observe(0, 1), observe(0, 2, (5, 6))]
    index, ratio = match_keypoints(keypoints[0], keypoints[1], config.matching)
    loss = structural_spatial_loss(keypoints[0].patches[index[:, 0]], keypoints[1].patches[index[:, 1]], config.ssl)
    assert loss.min() > 1e-3
    cost = {tuple(pair): value for pair, value in zip(index.tolist(), ratio + loss, strict=True)}
    found = match_frames(0, 1, keypoints, config)
    assert found.cost.tolist() == [cost[tuple(pair)] for pair in found.index.tolist()]
    assert len(found.cost) == len(found) == (loss <= config.ssl.max_loss).sum()


@pytest.mark.parametrize("max_gap", [1, 3, 50])
def test_each_frame_is_matched_with_previous_ones_smallest_gap_first(max_gap: int) -> None:
    config = Config(matching=MatchingConfig(max_gap=max_gap))
    keypoints = [observe(0, order) for order in range(6)]
    for frame in range(6):
        pairs = [(match.frame_a, match.frame_b) for match in match_with_previous(frame, keypoints, config, SONAR)]
        assert pairs == [(frame - gap, frame) for gap in range(1, min(max_gap, frame) + 1)]


def test_keypoints_of_later_frames_are_not_needed() -> None:
    assert len(match_with_previous(1, [observe(0, 0), observe(0, 1)], Config(), SONAR)) == 1


def test_frames_without_keypoints_have_empty_matches() -> None:
    keypoints = [observe(0, 0), no_keypoints(), no_keypoints()]
    for a, b in ((0, 1), (1, 2)):
        found = match_frames(a, b, keypoints, Config())
        assert (len(found), found.index.shape, found.cost.shape) == (0, (0, 2), (0,))


def test_different_scenes_have_no_matches() -> None:
    assert len(match_frames(0, 1, [observe(0, 1), observe(7, 2)], Config())) == 0


def test_given_pairs_are_matched_in_their_order() -> None:
    keypoints = [observe(0, order) for order in range(5)]
    found = match_pairs([(0, 4), (3, 1)], keypoints, Config(), SONAR)
    assert [(match.frame_a, match.frame_b, len(match)) for match in found] == [(0, 4, COUNT), (3, 1, COUNT)]


GUIDED = Config(matching=MatchingConfig(guided=True))
B_FROM_A = make_pose(np.array([0.1, -0.2, 0.0]), Rotation.from_euler("z", 0.1))
"""Frame b's sonar is the world frame, so that frame a's pose is the relative one."""


def two_views(seed: int, group_size: int) -> list[Keypoints]:
    """Observe points of a scene in two frames; groups of ``group_size`` points have the same descriptor and patch."""
    rng = np.random.default_rng(seed)
    points = random_points(rng, COUNT, (2, 8), 0.5, 0.09)
    descriptors = rng.integers(0, 256, (COUNT, 61), dtype=np.uint8)[np.arange(COUNT) // group_size]
    patches = rng.random((COUNT, WIDTH, WIDTH)).astype(np.float32)[np.arange(COUNT) // group_size]
    found = []
    for xyz_m in (points, transform(B_FROM_A, points)):
        noisy = descriptors ^ np.packbits(rng.random((COUNT, 488)) < 0.03, axis=1)
        found.append(observe_points(xyz_m, noisy, patches))
    return found


def predict(a_pose: FloatArray) -> PosePrediction:
    return PosePrediction(np.stack([a_pose, np.eye(4)]), 0.005, 0.02)


def count_correct(matches: Matches) -> int:
    return int((matches.index[:, 0] == matches.index[:, 1]).sum())


def test_guided_matching_resolves_points_of_equal_appearance() -> None:
    keypoints = two_views(1, group_size=3)
    unguided = match_frames(0, 1, keypoints, Config())
    guided = match_frames(0, 1, keypoints, GUIDED, predict(B_FROM_A))
    assert count_correct(guided) > 0.85 * COUNT > 0.5 * COUNT > count_correct(unguided)
    assert count_correct(guided) == len(guided)


def test_a_prediction_contradicted_by_the_images_is_ignored() -> None:
    keypoints = two_views(2, group_size=1)
    elsewhere = make_pose(np.array([1.5, 1.0, 0.0]), Rotation.from_euler("z", -0.5))
    for config in (Config(), GUIDED):
        found = match_frames(0, 1, keypoints, config, predict(elsewhere))
        assert count_correct(found) == len(found) > 0.9 * COUNT


def test_unguided_matching_loses_points_of_equal_appearance() -> None:
    keypoints = two_views(1, group_size=3)
    unguided = match_frames(0, 1, keypoints, Config(), predict(B_FROM_A))
    assert count_correct(unguided) < 0.5 * COUNT


def test_frames_without_keypoints_have_no_matches_under_a_prediction() -> None:
    for pair in ([no_keypoints(), two_views(1, 1)[1]], [two_views(1, 1)[0], no_keypoints()]):
        for config in (Config(), GUIDED):
            assert len(match_frames(0, 1, pair, config, predict(B_FROM_A))) == 0


def test_many_pairs_give_the_same_matches_as_one_at_a_time() -> None:
    keypoints = [*two_views(1, 2), *two_views(1, 1), no_keypoints()]
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


def test_the_first_frame_has_no_previous_ones() -> None:
    for guess in (None, predict(B_FROM_A)):
        assert match_with_previous(0, two_views(1, 1), Config(), SONAR, guess) == []


ELSEWHERE = make_pose(np.array([1.5, 1.0, 0.0]), Rotation.from_euler("z", -0.5))


@pytest.mark.parametrize(("count", "kept"), [(MIN_GAIN, 0), (MIN_GAIN + 1, MIN_GAIN + 1)])
def test_a_few_matches_do_not_contradict_a_prediction(monkeypatch: pytest.MonkeyPatch, count: int, kept: int) -> None:
    few = Matches(0, 1, np.stack([np.arange(count)] * 2, axis=1), np.zeros(count))
    monkeypatch.setattr("asfm.frontend.matching.pair_matching._match_unguided", lambda *_: [few])
    assert len(match_frames(0, 1, two_views(2, group_size=1), GUIDED, predict(ELSEWHERE))) == kept


@pytest.mark.parametrize(("more", "replaced"), [(0, False), (1, True)])
def test_twice_as_many_matches_and_some_more_contradict_a_prediction(
    monkeypatch: pytest.MonkeyPatch, more: int, replaced: bool
) -> None:
    keypoints = two_views(1, group_size=1)
    guided = len(match_frames(0, 1, keypoints, GUIDED, predict(B_FROM_A)))
    count = 2 * guided + MIN_GAIN + more
    many = Matches(0, 1, np.zeros((count, 2), dtype=np.int64), np.zeros(count))
    monkeypatch.setattr("asfm.frontend.matching.pair_matching.MIN_MATCHED_SHARE", 2.0)
    monkeypatch.setattr("asfm.frontend.matching.pair_matching._match_unguided", lambda *_: [many])
    assert guided > MIN_GAIN
    assert (match_frames(0, 1, keypoints, GUIDED, predict(B_FROM_A)) is many) == replaced


def test_a_frame_of_many_keypoints_does_not_make_the_matches_of_a_poorer_one_too_few(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Nearly all keypoints of the poorer frame are matched: nothing is matched again without the prediction."""
    rng = np.random.default_rng(0)
    a, b = two_views(1, group_size=1)
    clutter = observe_points(random_points(rng, 300, (2, 8), 0.5, 0.09))
    rich = make_keypoints(
        np.concatenate([b.range_m, clutter.range_m]),
        np.concatenate([b.bearing_rad, clutter.bearing_rad]),
        np.concatenate([b.descriptors, rng.integers(0, 256, (300, 61), dtype=np.uint8)]),
        np.concatenate([b.patches, rng.random((300, WIDTH, WIDTH))]),
    )
    again: list[tuple[int, int]] = []

    def match_again(frames: list[tuple[int, int]], *_: object) -> list[Matches]:
        again.extend(frames)
        return []

    monkeypatch.setattr("asfm.frontend.matching.pair_matching._match_unguided", match_again)
    assert len(match_frames(0, 1, [a, rich], GUIDED, predict(B_FROM_A))) > 0.85 * COUNT
    assert again == []


def test_keypoints_within_the_gate_of_the_prediction_are_candidates() -> None:
    """Ranges are off by two of three standard deviations."""
    a, b = two_views(1, group_size=3)
    _, sigma = predict_arcs((0, 1), a, SONAR, predict(B_FROM_A), GUIDED.noise)
    assert GUIDED.matching.arc_gate > 2.5
    off = make_keypoints(b.range_m + 2.0 * sigma[:, 0], b.bearing_rad, b.descriptors, b.patches)
    assert count_correct(match_frames(0, 1, [a, off], GUIDED, predict(B_FROM_A))) > 0.7 * COUNT
