"""Nearest neighbours of descriptors against OpenCV's brute-force matcher and against counting unpacked bits."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from asfm.config import MatchingConfig
from asfm.errors import AsfmError
from asfm.frontend.matching.nearest import (
    descriptor_distances,
    find_nearest_neighbours,
    hamming_distances,
    match_keypoints,
)
from asfm.types import Descriptors, Keypoints
from tests.worlds import make_keypoints

Bytes = NDArray[np.uint8]


def keypoints_of(descriptors: Descriptors) -> Keypoints:
    zeros = np.zeros(len(descriptors))
    return make_keypoints(zeros, zeros, descriptors)


def random_descriptors(rng: np.random.Generator, count: int, width: int = 61) -> Bytes:
    return rng.integers(0, 256, (count, width), dtype=np.uint8)


def flip_bits(rng: np.random.Generator, descriptors: Bytes, share: float) -> Bytes:
    return descriptors ^ np.packbits(rng.random((len(descriptors), 8 * descriptors.shape[1])) < share, axis=1)


@given(st.integers(0, 12), st.integers(0, 12), st.integers(1, 70), st.integers(0, 99))
def test_hamming_distance_counts_differing_bits(count_a: int, count_b: int, width: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = random_descriptors(rng, count_a, width), random_descriptors(rng, count_b, width)
    bits_a, bits_b = np.unpackbits(a, axis=1), np.unpackbits(b, axis=1)
    distance = hamming_distances(a, b)
    assert distance.shape == (count_a, count_b)
    np.testing.assert_array_equal(distance, (bits_a[:, None] != bits_b[None]).sum(axis=2))


def test_smallest_distances_equal_those_of_opencv() -> None:
    rng = np.random.default_rng(3)
    a, b = random_descriptors(rng, 80), random_descriptors(rng, 90)
    found = cv2.BFMatcher(cv2.NORM_HAMMING).match(a, b)
    np.testing.assert_array_equal(hamming_distances(a, b).min(axis=1), [pair.distance for pair in found])


def test_descriptors_may_be_strided_views() -> None:
    rng = np.random.default_rng(4)
    wide = random_descriptors(rng, 20, 122)
    np.testing.assert_array_equal(
        hamming_distances(wide[::2, ::2], wide[1::2, 1::2]),
        hamming_distances(wide[::2, ::2].copy(), wide[1::2, 1::2].copy()),
    )


def match_with_opencv(
    a: Descriptors, b: Descriptors, ratio: float, norm: int = cv2.NORM_HAMMING
) -> dict[tuple[int, int], float]:
    """Match with the ratio test and the mutual test of OpenCV's matcher."""
    matcher = cv2.BFMatcher(norm)
    back = {pair.queryIdx: pair.trainIdx for pair in matcher.match(b, a)}
    found = {}
    for first, second in matcher.knnMatch(a, b, k=2):
        value = first.distance / second.distance if second.distance > 0 else 1.0
        if value <= ratio and back[first.trainIdx] == first.queryIdx:
            found[first.queryIdx, first.trainIdx] = value
    return found


def match(a: Descriptors, b: Descriptors, ratio: float) -> dict[tuple[int, int], float]:
    index, value = match_keypoints(keypoints_of(a), keypoints_of(b), MatchingConfig(ratio=ratio))
    assert index.dtype == np.int64 and index.shape == (len(value), 2)
    return dict(zip(map(tuple, index.tolist()), value.tolist(), strict=True))


@settings(max_examples=40, deadline=None)
@given(st.integers(2, 60), st.integers(2, 60), st.sampled_from([0.6, 0.8, 0.9, 1.0]), st.integers(0, 2**32 - 1))
def test_matches_equal_those_of_opencv(count_a: int, count_b: int, ratio: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    a = random_descriptors(rng, count_a)
    b = np.concatenate([flip_bits(rng, a[: count_b // 2], 0.3), random_descriptors(rng, count_b)])[:count_b]
    b = b[rng.permutation(len(b))]
    assert match(a, b, ratio) == pytest.approx(match_with_opencv(a, b, ratio))


def test_shuffled_and_noisy_descriptors_are_matched() -> None:
    rng = np.random.default_rng(5)
    a = random_descriptors(rng, 200)
    order = rng.permutation(200)
    found = match(a, flip_bits(rng, a, 0.1)[order], 0.9)
    assert found.keys() == {(int(there), here) for here, there in enumerate(order)}


@settings(max_examples=30)
@given(st.integers(2, 30), st.integers(2, 30), st.integers(1, 2), st.integers(0, 2**32 - 1))
def test_no_keypoint_is_matched_twice_where_distances_tie(count_a: int, count_b: int, width: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = (rng.integers(0, 4, (count, width), dtype=np.uint8) for count in (count_a, count_b))
    index, value = match_keypoints(keypoints_of(a), keypoints_of(b), MatchingConfig(ratio=1.0))
    assert len(np.unique(index[:, 0])) == len(np.unique(index[:, 1])) == len(index)
    distance = hamming_distances(a, b)
    for (one, other), ratio in zip(index, value, strict=True):
        assert distance[one, other] == distance[one].min() == distance[:, other].min()
        assert 0 <= ratio <= 1


def test_a_keypoint_with_two_equally_near_neighbours_has_no_match() -> None:
    rng = np.random.default_rng(6)
    a = random_descriptors(rng, 4)
    twice = np.concatenate([flip_bits(rng, a, 0.02), a[:1], a[:1]])
    twice[0] = a[0]
    assert match(flip_bits(rng, a, 0.02), twice, 0.9).keys() == {(1, 1), (2, 2), (3, 3)}


@pytest.mark.parametrize(("count_a", "count_b"), [(0, 0), (0, 5), (5, 0), (1, 5), (5, 1), (1, 1)])
def test_fewer_than_two_keypoints_give_no_matches(count_a: int, count_b: int) -> None:
    rng = np.random.default_rng(7)
    assert match(random_descriptors(rng, count_a), random_descriptors(rng, count_b), 1.0) == {}


@settings(max_examples=30, deadline=None)
@given(st.integers(2, 40), st.integers(2, 40), st.sampled_from([0.7, 0.9, 1.0]), st.integers(0, 2**32 - 1))
def test_float_descriptors_use_the_euclidean_distance(count_a: int, count_b: int, ratio: float, seed: int) -> None:
    """As for SIFT, the ratio is that of distances, not of squared distances."""
    rng = np.random.default_rng(seed)
    a = (255 * rng.random((count_a, 128))).astype(np.float32)
    b = np.concatenate(
        [a[: count_b // 2] + rng.normal(0, 60, a[: count_b // 2].shape), 255 * rng.random((count_b, 128))]
    )
    b = b[:count_b][rng.permutation(count_b)].astype(np.float32)
    expected = match_with_opencv(a, b, ratio, cv2.NORM_L2)
    assert match(a, b, ratio) == pytest.approx(expected, rel=1e-4)


def test_distances_of_large_float_descriptors_are_accurate() -> None:
    rng = np.random.default_rng(8)
    a = (1000 + rng.random((20, 64))).astype(np.float32)
    expected = np.linalg.norm(a[:, None].astype(float) - a[None].astype(float), axis=-1)
    np.testing.assert_allclose(descriptor_distances(a, a), expected, atol=1e-3)


def test_identical_descriptors_give_no_match() -> None:
    """Nearest and second-nearest distance are both zero: the match is ambiguous and its ratio is 1."""
    same = np.zeros((5, 61), dtype=np.uint8)
    assert match(same, same, 0.99) == {}
    nearest = find_nearest_neighbours(keypoints_of(same), keypoints_of(same))
    assert nearest.ratio.tolist() == [1.0] * 5


def test_descriptors_that_are_not_finite_give_no_match() -> None:
    rng = np.random.default_rng(9)
    a = rng.random((12, 32)).astype(np.float32)
    b = a.copy()
    a[3], b[5, 7] = np.nan, np.inf
    found = match(a, b, 0.9)
    assert found.keys() == {(index, index) for index in range(12) if index not in (3, 5)}
    assert match(np.full_like(a, np.nan), b, 1.0) == {}


@pytest.mark.parametrize(
    ("other", "found"), [(np.zeros((4, 32), dtype=np.uint8), "length 32"), (np.zeros((4, 61), np.float32), "float32")]
)
def test_descriptors_of_different_types_are_an_error_in_one_line(other: Descriptors, found: str) -> None:
    with pytest.raises(AsfmError, match=found) as error:
        match(np.zeros((4, 61), dtype=np.uint8), other, 0.9)
    assert "\n" not in str(error.value)


def test_pairs_that_are_not_allowed_are_ignored() -> None:
    """A similar descriptor that is not allowed is neither nearest nor second nearest."""
    rng = np.random.default_rng(10)
    a = random_descriptors(rng, 30)
    twins = np.concatenate([flip_bits(rng, a, 0.1), flip_bits(rng, a, 0.1)])
    allowed = np.tile(np.eye(30, dtype=bool), (1, 2))
    allowed[:, 30:] = False
    assert len(match_keypoints(keypoints_of(a), keypoints_of(twins), MatchingConfig(ratio=0.4))[0]) == 0
    nearest = find_nearest_neighbours(keypoints_of(a), keypoints_of(twins), allowed)
    np.testing.assert_array_equal(nearest.index, np.stack([np.arange(30)] * 2, axis=1))
    assert nearest.mutual.all() and nearest.ratio.max() < 0.4


def test_ratio_of_a_single_candidate_uses_the_mean_distance() -> None:
    rng = np.random.default_rng(11)
    a, b = random_descriptors(rng, 30), random_descriptors(rng, 30)
    b[:15] = flip_bits(rng, a[:15], 0.1)
    nearest = find_nearest_neighbours(keypoints_of(a), keypoints_of(b), np.eye(30, dtype=bool))
    assert nearest.ratio[:15].max() < 0.4 and nearest.ratio[15:].min() > 0.8


def test_no_allowed_pair_gives_no_match() -> None:
    rng = np.random.default_rng(12)
    frame = keypoints_of(random_descriptors(rng, 6))
    assert len(find_nearest_neighbours(frame, frame, np.zeros((6, 6), dtype=bool)).index) == 0
