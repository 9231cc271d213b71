"""Hamming matching against OpenCV's brute-force matcher and against counting bits one by one."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from asfm.config import MatchingConfig
from asfm.frontend.matching import hamming_distances, match_keypoints
from asfm.types import Keypoints

Descriptors = NDArray[np.uint8]


def keypoints_of(descriptors: Descriptors) -> Keypoints:
    count = len(descriptors)
    nothing = np.zeros(count)
    return Keypoints(
        np.zeros((count, 2)), nothing, nothing, nothing, descriptors, np.zeros((count, 3, 3), dtype=np.float32)
    )


def random_descriptors(rng: np.random.Generator, count: int, width: int = 61) -> Descriptors:
    return rng.integers(0, 256, (count, width), dtype=np.uint8)


def flip_bits(rng: np.random.Generator, descriptors: Descriptors, share: float) -> Descriptors:
    return descriptors ^ np.packbits(rng.random((len(descriptors), 8 * descriptors.shape[1])) < share, axis=1)


@given(st.integers(0, 12), st.integers(0, 12), st.integers(1, 70), st.integers(0, 99))
def test_distances_count_the_bits_that_differ(count_a: int, count_b: int, width: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = random_descriptors(rng, count_a, width), random_descriptors(rng, count_b, width)
    bits_a, bits_b = np.unpackbits(a, axis=1), np.unpackbits(b, axis=1)
    distance = hamming_distances(a, b)
    assert distance.shape == (count_a, count_b)
    np.testing.assert_array_equal(distance, (bits_a[:, None] != bits_b[None]).sum(axis=2))


def test_nearest_distances_are_those_of_opencv() -> None:
    rng = np.random.default_rng(3)
    a, b = random_descriptors(rng, 80), random_descriptors(rng, 90)
    found = cv2.BFMatcher(cv2.NORM_HAMMING).match(a, b)
    np.testing.assert_array_equal(hamming_distances(a, b).min(axis=1), [match.distance for match in found])


def test_descriptors_need_not_be_contiguous() -> None:
    rng = np.random.default_rng(4)
    wide = random_descriptors(rng, 20, 122)
    np.testing.assert_array_equal(
        hamming_distances(wide[::2, ::2], wide[1::2, 1::2]),
        hamming_distances(wide[::2, ::2].copy(), wide[1::2, 1::2].copy()),
    )


def match_with_opencv(a: Descriptors, b: Descriptors, ratio: float) -> dict[tuple[int, int], float]:
    """Ratio test and mutual test with OpenCV's matcher."""
    matcher = cv2.BFMatcher(cv2.NORM_HAMMING)
    back = {match.queryIdx: match.trainIdx for match in matcher.match(b, a)}
    found = {}
    for first, second in matcher.knnMatch(a, b, k=2):
        value = first.distance / max(second.distance, 1.0)
        if value <= ratio and back[first.trainIdx] == first.queryIdx:
            found[first.queryIdx, first.trainIdx] = value
    return found


def ours(a: Descriptors, b: Descriptors, ratio: float) -> dict[tuple[int, int], float]:
    index, value = match_keypoints(keypoints_of(a), keypoints_of(b), MatchingConfig(ratio=ratio))
    assert index.dtype == np.int64 and index.shape == (len(value), 2)
    return dict(zip(map(tuple, index.tolist()), value.tolist(), strict=True))


@settings(max_examples=40, deadline=None)
@given(st.integers(2, 60), st.integers(2, 60), st.sampled_from([0.6, 0.8, 0.9, 1.0]), st.integers(0, 2**32 - 1))
def test_matches_are_those_of_opencv(count_a: int, count_b: int, ratio: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    a = random_descriptors(rng, count_a)
    b = np.concatenate([flip_bits(rng, a[: count_b // 2], 0.3), random_descriptors(rng, count_b)])[:count_b]
    b = b[rng.permutation(len(b))]
    assert ours(a, b, ratio) == pytest.approx(match_with_opencv(a, b, ratio))


def test_shuffled_and_noisy_descriptors_are_found_again() -> None:
    rng = np.random.default_rng(5)
    a = random_descriptors(rng, 200)
    order = rng.permutation(200)
    found = ours(a, flip_bits(rng, a, 0.1)[order], 0.9)
    assert found.keys() == {(int(there), here) for here, there in enumerate(order)}


@settings(max_examples=30)
@given(st.integers(2, 30), st.integers(2, 30), st.integers(1, 2), st.integers(0, 2**32 - 1))
def test_nobody_is_matched_twice_even_where_distances_tie(count_a: int, count_b: int, width: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = (rng.integers(0, 4, (count, width), dtype=np.uint8) for count in (count_a, count_b))
    index, value = match_keypoints(keypoints_of(a), keypoints_of(b), MatchingConfig(ratio=1.0))
    assert len(np.unique(index[:, 0])) == len(np.unique(index[:, 1])) == len(index)
    distance = hamming_distances(a, b)
    for (one, other), ratio in zip(index, value, strict=True):
        assert distance[one, other] == distance[one].min() == distance[:, other].min()
        assert 0 <= ratio <= 1


def test_a_second_as_near_as_the_first_is_no_match() -> None:
    rng = np.random.default_rng(6)
    a = random_descriptors(rng, 4)
    twice = np.concatenate([flip_bits(rng, a, 0.02), a[:1], a[:1]])
    twice[0] = a[0]
    assert all(one != 0 for one, _ in ours(flip_bits(rng, a, 0.02), twice, 0.9))


@pytest.mark.parametrize(("count_a", "count_b"), [(0, 0), (0, 5), (5, 0), (1, 5), (5, 1), (1, 1)])
def test_too_few_to_compare_are_no_matches(count_a: int, count_b: int) -> None:
    rng = np.random.default_rng(7)
    assert ours(random_descriptors(rng, count_a), random_descriptors(rng, count_b), 1.0) == {}
