"""Precision, recall and localisation errors of matches with known truth."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.evaluation.arc_consistency import Tolerance
from asfm.evaluation.matching import (
    MatchQuality,
    evaluate_by_arcs,
    evaluate_by_truth,
    evaluate_pair,
    pool_pairs,
)
from asfm.evaluation.true_positions import TruePositions, find_true_positions
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import SonarModel, back_project, project
from asfm.sequence import Sequence
from asfm.types import FloatArray, Frame, FrameTruth, IntArray, Keypoints, Matches, Trajectory

SONAR = SonarModel.evenly_spaced("test", (0.5, 8.0), (-0.6, 0.6), (300, 128), 0.25)
A_FROM_B = make_pose(np.array([0.3, -0.2, 0.1]), Rotation.from_euler("zyx", [4, -3, 6], degrees=True))


def keypoints_at(range_m: FloatArray, bearing_rad: FloatArray) -> Keypoints:
    count = len(range_m)
    return Keypoints(
        row_column=np.stack([SONAR.row_at_range(range_m), SONAR.column_at_bearing(bearing_rad)], axis=1),
        range_m=range_m,
        bearing_rad=bearing_rad,
        response=np.ones(count),
        descriptors=np.zeros((count, 61), dtype=np.uint8),
        patches=np.zeros((count, 3, 3), dtype=np.float32),
    )


def matches_of(index: IntArray | list[tuple[int, int]], frame_a: int = 0, frame_b: int = 1) -> Matches:
    pairs = np.array(index, dtype=np.int64).reshape(-1, 2)
    return Matches(frame_a, frame_b, pairs, np.zeros(len(pairs)))


def scene(count: int, seed: int = 0) -> tuple[Keypoints, Keypoints, FloatArray]:
    """Make keypoints of the same points in frames a and b, row by row, and the elevation image of frame a."""
    rng = np.random.default_rng(seed)
    row, column = rng.choice(np.arange(20, 280), count, False), rng.integers(20, 108, count)
    elevation_rad = np.full(SONAR.shape, np.nan)
    elevation_rad[row, column] = rng.uniform(-0.12, 0.12, count)
    range_m, bearing_rad = SONAR.range_m[row], SONAR.bearing_rad[column]
    in_a_m = back_project(range_m, bearing_rad, elevation_rad[row, column])
    range_b_m, bearing_b_rad, _ = project(transform(invert(A_FROM_B), in_a_m))
    return keypoints_at(range_m, bearing_rad), keypoints_at(range_b_m, bearing_b_rad), elevation_rad


def evaluate(a: Keypoints, b: Keypoints, matches: Matches, elevation_rad: FloatArray) -> MatchQuality:
    return evaluate_pair(find_true_positions(a, elevation_rad, invert(A_FROM_B)), b, matches)


def same(count: int) -> list[tuple[int, int]]:
    return [(row, row) for row in range(count)]


def test_true_matches_are_correct_and_shifted_ones_are_not() -> None:
    a, b, elevation_rad = scene(40)
    right = evaluate(a, b, matches_of(same(40)), elevation_rad)
    assert (right.matches, right.correct, right.possible, right.recalled) == (40, 40, 40, 40)
    assert (right.precision, right.recall) == (1.0, 1.0)
    np.testing.assert_allclose(right.range_error_m, 0, atol=1e-9)
    np.testing.assert_allclose(right.bearing_error_rad, 0, atol=1e-9)
    far = [row for row in range(39) if abs(b.range_m[row] - b.range_m[row + 1]) > 0.2]
    wrong = evaluate(a, b, matches_of([(row, row + 1) for row in far]), elevation_rad)
    assert (wrong.correct, wrong.precision, wrong.recall) == (0, 0.0, 0.0)


def test_precision_and_recall_of_a_known_mixture() -> None:
    a, b, elevation_rad = scene(20)
    wrong = (3, int(np.argmax(np.abs(b.range_m - b.range_m[3]))))
    quality = evaluate(a, b, matches_of([*same(3), wrong]), elevation_rad)
    assert quality.precision == 0.75
    assert quality.recall == pytest.approx(3 / 20)


@pytest.mark.parametrize(
    ("range_m", "bearing_deg", "correct"),
    [(0.099, 0, True), (-0.099, 0, True), (0.101, 0, False), (0, 1.49, True), (0, -1.51, False), (0.09, 1.4, True)],
)
def test_tolerances(range_m: float, bearing_deg: float, correct: bool) -> None:
    a, b, elevation_rad = scene(1)
    moved = replace(b, range_m=b.range_m + range_m, bearing_rad=b.bearing_rad + np.radians(bearing_deg))
    truth = find_true_positions(a, elevation_rad, invert(A_FROM_B))
    assert evaluate_pair(truth, moved, matches_of([(0, 0)])).correct == int(correct)
    assert evaluate_pair(truth, moved, matches_of([(0, 0)]), Tolerance(0.2, 0.1)).correct == 1


def test_errors_of_correct_matches_are_those_added() -> None:
    a, b, elevation_rad = scene(200)
    rng = np.random.default_rng(1)
    noisy = replace(
        b,
        range_m=b.range_m + rng.normal(scale=0.02, size=200),
        bearing_rad=b.bearing_rad + rng.normal(scale=0.005, size=200),
    )
    quality = evaluate(a, noisy, matches_of(same(200)), elevation_rad)
    assert quality.precision == 1.0
    np.testing.assert_allclose(quality.range_error_m, noisy.range_m - b.range_m, atol=1e-9)
    np.testing.assert_allclose(quality.bearing_error_rad, noisy.bearing_rad - b.bearing_rad, atol=1e-9)


def test_matches_of_a_keypoint_on_noise_are_never_correct() -> None:
    a, b, elevation_rad = scene(5)
    quality = evaluate(a, b, matches_of(same(5)), np.full_like(elevation_rad, np.nan))
    assert (quality.correct, quality.possible, quality.precision, quality.recall) == (0, 0, 0.0, None)


def test_unknown_true_positions_match_nothing_at_the_origin() -> None:
    a, _, elevation_rad = scene(1)
    at_the_sonar = keypoints_at(np.array([0.05]), np.array([0.0]))
    quality = evaluate(a, at_the_sonar, matches_of([(0, 0)]), np.full_like(elevation_rad, np.nan))
    assert (quality.correct, quality.possible) == (0, 0)


def test_a_keypoint_matched_twice_is_recalled_once() -> None:
    a, b, elevation_rad = scene(1)
    twice = keypoints_at(np.repeat(b.range_m, 2), np.repeat(b.bearing_rad, 2))
    quality = evaluate(a, twice, matches_of([(0, 0), (0, 1)]), elevation_rad)
    assert (quality.correct, quality.recalled, quality.recall) == (2, 1, 1.0)


def test_no_matches_and_no_keypoints() -> None:
    a, b, elevation_rad = scene(3)
    none = keypoints_at(np.zeros(0), np.zeros(0))
    for first, second in ((a, b), (none, b), (a, none), (none, none)):
        quality = evaluate(first, second, matches_of([]), elevation_rad)
        assert quality.precision is None
        assert (quality.matches, quality.correct, quality.recalled) == (0, 0, 0)


def test_pooling_adds_up() -> None:
    parts = []
    for seed in range(3):
        a, b, elevation_rad = scene(10, seed)
        parts.append(evaluate(a, b, matches_of(same(seed + 2)), elevation_rad))
    pooled = pool_pairs(parts)
    assert (pooled.matches, pooled.correct, pooled.possible, pooled.recalled) == (9, 9, 30, 9)
    assert len(pooled.range_error_m) == 9
    assert pool_pairs([]).precision is None


class Run:
    """Four frames, alternately at a and at b, of a run in a world of its own."""

    def __init__(self, count: int = 30) -> None:
        a, b, elevation_rad = scene(count)
        self.keypoints = [a, b, a, b]
        world_from_a = make_pose(np.array([9.0, -4, 2]), Rotation.from_euler("z", 1.0))
        lever_arm = make_pose(np.array([0.4, 0.1, -0.2]), Rotation.from_euler("zyx", [5, 20, -3], degrees=True))
        world_from_sonar = np.stack([world_from_a, world_from_a @ A_FROM_B] * 2)
        stamps_s, self.world_from_sonar, self.read = np.arange(4.0), world_from_sonar, list[int]()
        self.sequence = Sequence(
            name="made up",
            sonar=SONAR,
            timestamps_s=stamps_s,
            read_frame=no_image,
            vehicle_from_sonar=lever_arm,
            groundtruth=Trajectory(stamps_s, world_from_sonar @ invert(lever_arm)),
        )
        self.elevation_rad = elevation_rad

    def read_truth(self, index: int) -> FrameTruth:
        self.read.append(index)
        assert index in (0, 2), "only the truth of frames at a is needed"
        return FrameTruth(self.elevation_rad, np.zeros(SONAR.shape, np.float32))


def no_image(index: int) -> Frame:
    raise AssertionError(f"matching is evaluated without images, frame {index} was requested")


def shifted(keypoints: Keypoints, count: int) -> list[tuple[int, int]]:
    """List wrong matches: partners whose ranges differ clearly."""
    order = np.argsort(keypoints.range_m)
    return [(int(order[row]), int(order[row - len(order) // 2])) for row in range(count)]


def test_gaps_are_evaluated_apart() -> None:
    run = Run()
    wrong = shifted(run.keypoints[1], 10)
    matches = [matches_of(same(6), 2, 3), matches_of([*same(10), *wrong], 0, 1), matches_of(wrong, 0, 3)]
    found = evaluate_by_truth(run.keypoints, matches, run.world_from_sonar, run.read_truth)
    assert list(found) == [1, 3] and run.read == [0, 2]
    assert (found[1].matches, found[1].correct, found[1].recalled, found[1].possible) == (26, 16, 16, 60)
    assert (found[3].matches, found[3].correct, found[3].possible) == (10, 0, 30)
    inlier = evaluate_by_arcs(run.keypoints, matches, run.world_from_sonar, SONAR)
    assert [len(each) for each in inlier.values()] == [26, 10]
    assert inlier[1][:16].all() and not inlier[1][16:].any() and not inlier[3].any()


@pytest.mark.parametrize("seed", range(3))
def test_possible_partners_are_those_of_a_search_over_all_pairs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    b = keypoints_at(rng.uniform(1, 3, 300), rng.uniform(-np.pi, np.pi, 300))
    truth = TruePositions(rng.uniform(0.8, 3.2, 200), rng.uniform(-np.pi, np.pi, 200), rng.random(200) < 0.8)
    bearing_error_rad = np.angle(np.exp(1j * (b.bearing_rad - truth.bearing_rad[:, None])))
    near = (np.abs(b.range_m - truth.range_m[:, None]) <= 0.1) & (np.abs(bearing_error_rad) <= np.radians(1.5))
    expected = int((near.any(axis=1) & truth.known).sum())
    assert 0 < expected < 200
    assert evaluate_pair(truth, b, matches_of([])).possible == expected


def test_bearings_on_either_side_of_half_a_turn_agree() -> None:
    """A sonar that sees behind itself measures pi - 0.005 rad where the truth is -pi + 0.005 rad."""
    truth = TruePositions(np.full(1, 3.0), np.full(1, 0.005 - np.pi), np.ones(1, dtype=bool))
    quality = evaluate_pair(truth, keypoints_at(np.full(1, 3.0), np.full(1, np.pi - 0.005)), matches_of(same(1)))
    assert (quality.precision, quality.recall) == (1.0, 1.0)
    np.testing.assert_allclose(quality.bearing_error_rad, -0.01, atol=1e-12)
