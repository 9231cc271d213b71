"""Precision, recall and errors of matches whose truth is made here."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from asfm.datasets import open_sequence, open_truth
from asfm.evaluation.matching import (
    MatchQuality,
    describe_matches,
    evaluate_matches,
    find_true_positions,
    judge_matches,
    look_up_elevation,
    pool_matches,
)
from asfm.geometry.poses import interpolate, invert, make_pose, transform
from asfm.geometry.sonar import SonarModel, back_project, project
from asfm.types import FloatArray, IntArray, Keypoints, Matches

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


def matches_of(index: IntArray | list[tuple[int, int]]) -> Matches:
    pairs = np.array(index, dtype=np.int64).reshape(-1, 2)
    return Matches(0, 1, pairs, np.zeros(len(pairs)))


def scene(count: int, seed: int = 0) -> tuple[Keypoints, Keypoints, FloatArray]:
    """Keypoints of the same points in frames a and b, row by row, and the elevation image of frame a."""
    rng = np.random.default_rng(seed)
    row, column = rng.choice(np.arange(20, 280), count, False), rng.integers(20, 108, count)
    elevation_rad = np.full(SONAR.shape, np.nan)
    elevation_rad[row, column] = rng.uniform(-0.12, 0.12, count)
    range_m, bearing_rad = SONAR.range_m[row], SONAR.bearing_rad[column]
    in_a_m = back_project(range_m, bearing_rad, elevation_rad[row, column])
    range_b_m, bearing_b_rad, _ = project(transform(invert(A_FROM_B), in_a_m))
    return keypoints_at(range_m, bearing_rad), keypoints_at(range_b_m, bearing_b_rad), elevation_rad


def evaluate(a: Keypoints, b: Keypoints, matches: Matches, elevation_rad: FloatArray) -> MatchQuality:
    world_from_a = make_pose(np.array([9.0, -4, 2]), Rotation.from_euler("z", 1.0))
    return evaluate_matches(a, b, matches, elevation_rad, world_from_a, world_from_a @ A_FROM_B)


def test_true_matches_are_right_and_shuffled_ones_are_not() -> None:
    a, b, elevation_rad = scene(40)
    right = evaluate(a, b, matches_of([(row, row) for row in range(40)]), elevation_rad)
    assert (right.matches, right.right, right.possible, right.found) == (40, 40, 40, 40)
    assert (right.precision, right.recall) == (1.0, 1.0)
    np.testing.assert_allclose(right.range_error_m, 0, atol=1e-9)
    np.testing.assert_allclose(right.bearing_error_rad, 0, atol=1e-9)
    far = [row for row in range(39) if abs(b.range_m[row] - b.range_m[row + 1]) > 0.2]
    wrong = evaluate(a, b, matches_of([(row, row + 1) for row in far]), elevation_rad)
    assert (wrong.right, wrong.precision, wrong.recall) == (0, 0.0, 0.0)


def test_precision_and_recall_of_a_known_mixture() -> None:
    a, b, elevation_rad = scene(20)
    near = [(0, 0), (1, 1), (2, 2)]
    quality = evaluate(a, b, matches_of([*near, (3, int(np.argmax(np.abs(b.range_m - b.range_m[3]))))]), elevation_rad)
    assert quality.precision == 0.75
    assert quality.recall == pytest.approx(3 / 20)


@pytest.mark.parametrize(
    ("range_m", "bearing_deg", "right"),
    [(0.099, 0, True), (-0.099, 0, True), (0.101, 0, False), (0, 1.49, True), (0, -1.51, False), (0.09, 1.4, True)],
)
def test_tolerances(range_m: float, bearing_deg: float, right: bool) -> None:
    a, b, elevation_rad = scene(1)
    moved = replace(b, range_m=b.range_m + range_m, bearing_rad=b.bearing_rad + np.radians(bearing_deg))
    truth = find_true_positions(a, elevation_rad, invert(A_FROM_B))
    assert judge_matches(truth, moved, matches_of([(0, 0)])).tolist() == [right]
    assert judge_matches(truth, moved, matches_of([(0, 0)]), 0.2, 0.1).tolist() == [True]


def test_errors_of_right_matches_are_those_put_in() -> None:
    a, b, elevation_rad = scene(200)
    rng = np.random.default_rng(1)
    noisy = replace(
        b,
        range_m=b.range_m + rng.normal(scale=0.02, size=200),
        bearing_rad=b.bearing_rad + rng.normal(scale=0.005, size=200),
    )
    quality = evaluate(a, noisy, matches_of([(row, row) for row in range(200)]), elevation_rad)
    rows = {name: (value, unit) for name, value, unit in describe_matches(quality)}
    assert rows["precision"] == (100.0, "%")
    assert rows["range error of right matches, RMSE"][0] == pytest.approx(0.02, rel=0.15)
    assert rows["bearing error of right matches, RMSE"][0] == pytest.approx(np.degrees(0.005), rel=0.15)


def test_keypoint_on_noise_is_never_right() -> None:
    a, b, elevation_rad = scene(5)
    quality = evaluate(a, b, matches_of([(row, row) for row in range(5)]), np.full_like(elevation_rad, np.nan))
    assert (quality.right, quality.possible, quality.precision, quality.recall) == (0, 0, 0.0, None)


def test_unknown_truth_is_not_taken_for_the_origin() -> None:
    a, _, elevation_rad = scene(1)
    at_the_sonar = keypoints_at(np.array([0.05]), np.array([0.0]))
    quality = evaluate(a, at_the_sonar, matches_of([(0, 0)]), np.full_like(elevation_rad, np.nan))
    assert (quality.right, quality.possible) == (0, 0)


def test_one_keypoint_matched_twice_is_found_once() -> None:
    a, b, elevation_rad = scene(1)
    twice = keypoints_at(np.repeat(b.range_m, 2), np.repeat(b.bearing_rad, 2))
    quality = evaluate(a, twice, matches_of([(0, 0), (0, 1)]), elevation_rad)
    assert (quality.right, quality.found, quality.recall) == (2, 1, 1.0)


def test_no_matches_and_no_keypoints() -> None:
    a, b, elevation_rad = scene(3)
    none = keypoints_at(np.zeros(0), np.zeros(0))
    for first, second in ((a, b), (none, b), (a, none), (none, none)):
        quality = evaluate(first, second, matches_of([]), elevation_rad)
        assert quality.precision is None
        assert describe_matches(quality)[:2] == (("matches", 0.0, "matches"), ("right matches", 0.0, "matches"))


def test_pooling_adds_up() -> None:
    parts = []
    for seed in range(3):
        a, b, elevation_rad = scene(10, seed)
        parts.append(evaluate(a, b, matches_of([(row, row) for row in range(seed + 2)]), elevation_rad))
    pooled = pool_matches(parts)
    assert (pooled.matches, pooled.right, pooled.possible, pooled.found) == (9, 9, 30, 9)
    assert len(pooled.range_error_m) == 9
    assert pool_matches([]).precision is None


def test_elevation_of_the_nearest_pixel_counts() -> None:
    elevation_rad = np.full((10, 10), np.nan)
    elevation_rad[4, 4], elevation_rad[4, 6] = 0.1, 0.2
    places = np.array([[4.5, 4.5], [4.5, 5.4], [4.5, 5.6], [6.4, 4.5], [6.6, 4.5], [0.0, 0.0], [9.99, 9.99]])
    found, known = look_up_elevation(places, elevation_rad)
    np.testing.assert_array_equal(known, [True, True, True, True, False, False, False])
    np.testing.assert_array_equal(found, [0.1, 0.1, 0.2, 0.1, 0, 0, 0])
    assert look_up_elevation(places, elevation_rad, reach_px=0.75)[1].tolist() == [True, False, False] + [False] * 4


@given(st.integers(0, 2**32 - 1), st.floats(0.5, 3))
def test_look_up_agrees_with_a_plain_search(seed: int, reach_px: float) -> None:
    rng = np.random.default_rng(seed)
    elevation_rad = np.where(rng.uniform(size=(8, 6)) < 0.2, rng.normal(size=(8, 6)), np.nan)
    places = rng.uniform(0, [8, 6], size=(5, 2))
    found, known = look_up_elevation(places, elevation_rad, reach_px)
    filled = np.argwhere(np.isfinite(elevation_rad))
    for place, value, sure in zip(places, found, known, strict=True):
        distance_px = np.linalg.norm(filled + 0.5 - place, axis=1)
        assert sure == bool(len(filled) and distance_px.min() <= reach_px)
        if sure:
            assert value == elevation_rad[tuple(filled[np.argmin(distance_px)])]


def test_truth_of_the_simulated_seafloor_carries_echoes_to_the_next_frames(shared_data: Path) -> None:
    """An independent check of frames and signs: where the echo of frame a is carried to, frame b has that elevation."""
    folder = shared_data / "simulated_seafloor"
    sequence, read_truth = open_sequence(folder), open_truth(folder)
    assert sequence.groundtruth is not None
    assert read_truth is not None
    stamps_s = sequence.timestamps_s[[10, 14]]
    poses = interpolate(sequence.groundtruth.timestamps_s, sequence.groundtruth.world_from_vehicle, stamps_s)
    truth_a, truth_b = read_truth(10), read_truth(14)
    strong = np.argwhere(np.isfinite(truth_a.elevation_rad) & (truth_a.clean > 0.3))[::50]
    range_m, bearing_rad = sequence.sonar.range_m[strong[:, 0]], sequence.sonar.bearing_rad[strong[:, 1]]
    elevation_rad, known = look_up_elevation(strong.astype(float) + 0.5, truth_a.elevation_rad)
    assert known.all()
    in_b_m = transform(invert(poses[1]) @ poses[0], back_project(range_m, bearing_rad, elevation_rad))
    range_b_m, bearing_b_rad, expected_rad = project(in_b_m)
    seen = sequence.sonar.sees(in_b_m)
    pixel = np.stack([sequence.sonar.row_at_range(range_b_m), sequence.sonar.column_at_bearing(bearing_b_rad)], axis=1)
    found_rad, known = look_up_elevation(pixel[seen], truth_b.elevation_rad)
    assert seen.sum() > 30
    assert known.mean() > 0.9
    assert np.median(np.abs(found_rad - expected_rad[seen])[known]) < np.radians(0.5)
