"""Nearest-neighbour matching of descriptors: Hamming distance for binary descriptors, Euclidean for others."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from asfm.config import MatchingConfig
from asfm.errors import AsfmError
from asfm.types import BoolArray, Descriptors, FloatArray, IntArray, Keypoints


@dataclass(frozen=True)
class NearestNeighbours:
    """Nearest keypoint of frame b for each keypoint of frame a that has a candidate."""

    index: IntArray
    """(M, 2) keypoint of frame a (ascending), keypoint of frame b."""
    ratio: FloatArray
    """(M,) nearest over second-nearest distance, 0..1; 1 where both are equal, also if both are zero."""
    mutual: BoolArray
    """(M,) whether the keypoint of frame a is also the nearest neighbour of that of frame b."""


def match_keypoints(frame_a: Keypoints, frame_b: Keypoints, config: MatchingConfig) -> tuple[IntArray, FloatArray]:
    """Match keypoints by mutual nearest neighbours and the ratio test (Lowe 2004).

    Returns:
        (M, 2) indices into frame_a and frame_b, (M,) ratios of nearest to second-nearest distance, smaller is better.
    """
    nearest = find_nearest_neighbours(frame_a, frame_b)
    keep = nearest.mutual & (nearest.ratio <= config.ratio)
    return nearest.index[keep], nearest.ratio[keep]


def find_nearest_neighbours(
    frame_a: Keypoints, frame_b: Keypoints, allowed: BoolArray | None = None
) -> NearestNeighbours:
    """Find the nearest descriptor of frame b for each of frame a, among the allowed pairs.

    A keypoint with a single candidate has no second-nearest neighbour; its ratio uses the mean distance to all
    keypoints of frame b instead. Descriptors that are not finite have no neighbours.

    Args:
        frame_a: the (Ka,) keypoints of frame a; with fewer than two in either frame there are no matches.
        frame_b: the (Kb,) keypoints of frame b.
        allowed: (Ka, Kb) which pairs are candidates; None allows all.

    Raises:
        AsfmError: the descriptors differ in type or length.
    """
    if len(frame_a) < 2 or len(frame_b) < 2:
        return NearestNeighbours(np.zeros((0, 2), dtype=np.int64), np.zeros(0), np.zeros(0, dtype=bool))
    distance = descriptor_distances(frame_a.descriptors, frame_b.descriptors)
    fallback = np.full(len(frame_a), np.inf, dtype=np.float32)
    if allowed is not None:
        fallback = distance.mean(axis=1)
        np.copyto(distance, np.float32(np.inf), where=~allowed)
    rows = np.arange(len(frame_a))
    nearest = distance.argmin(axis=1)
    first = distance[rows, nearest]
    mutual = distance.argmin(axis=0)[nearest] == rows
    distance[rows, nearest] = np.inf
    second = distance[rows, distance.argmin(axis=1)]
    second = np.where(np.isfinite(second), second, fallback)
    finite = np.isfinite(first) & np.isfinite(second)
    first, second = first[finite].astype(float), second[finite].astype(float)
    ratio = np.where(second > first, first / np.where(second > 0, second, 1.0), 1.0)
    return NearestNeighbours(np.stack([rows[finite], nearest[finite]], axis=1), ratio, mutual[finite])


def descriptor_distances(descriptors_a: Descriptors, descriptors_b: Descriptors) -> NDArray[np.float32]:
    """Compute the distances between all descriptors of two frames.

    Args:
        descriptors_a: (Ka, D) bytes (binary descriptors, Hamming distance) or floats (Euclidean distance).
        descriptors_b: (Kb, D) of the same type.

    Returns:
        (Ka, Kb) distances, infinite where a descriptor is not finite.

    Raises:
        AsfmError: the descriptors differ in type or length.
    """
    binary = [descriptors.dtype == np.uint8 for descriptors in (descriptors_a, descriptors_b)]
    if binary[0] != binary[1] or descriptors_a.shape[1] != descriptors_b.shape[1]:
        found = [f"{each.dtype} of length {each.shape[1]}" for each in (descriptors_a, descriptors_b)]
        raise AsfmError(
            f"matching: expected descriptors of one type and length, found {found[0]} and {found[1]}; "
            "detect the keypoints of all frames with one detector"
        )
    if binary[0]:
        return _count_bits(descriptors_a.astype(np.uint8, copy=False), descriptors_b.astype(np.uint8, copy=False))
    return _euclidean_distances(np.asarray(descriptors_a, dtype=float), np.asarray(descriptors_b, dtype=float))


def hamming_distances(descriptors_a: NDArray[np.uint8], descriptors_b: NDArray[np.uint8]) -> IntArray:
    """Return the Hamming distances (Ka, Kb) between (Ka, D) and (Kb, D) binary descriptors, in bits."""
    return _count_bits(descriptors_a, descriptors_b).astype(np.int64)


def _count_bits(descriptors_a: NDArray[np.uint8], descriptors_b: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return the Hamming distances (Ka, Kb), computed in words of eight bytes in buffers allocated once."""
    words_a, words_b = _as_words(descriptors_a).T, np.ascontiguousarray(_as_words(descriptors_b).T)
    shape = len(descriptors_a), len(descriptors_b)
    differing, bits = np.empty(shape, dtype=np.uint64), np.empty(shape, dtype=np.uint8)
    distance = np.zeros(shape, dtype=np.uint16)
    for word_a, word_b in zip(words_a, words_b, strict=True):
        np.bitwise_xor(word_a[:, None], word_b, out=differing)
        np.bitwise_count(differing, out=bits)
        np.add(distance, bits, out=distance)
    return distance.astype(np.float32)


def _as_words(descriptors: NDArray[np.uint8]) -> NDArray[np.uint64]:
    """Pack (K, D) bytes into (K, ceil(D / 8)) words, padded with zeros."""
    padded = np.zeros((len(descriptors), -(-descriptors.shape[1] // 8) * 8), dtype=np.uint8)
    padded[:, : descriptors.shape[1]] = descriptors
    return padded.view(np.uint64)


def _euclidean_distances(descriptors_a: FloatArray, descriptors_b: FloatArray) -> NDArray[np.float32]:
    """Return the Euclidean distances by |a|^2 + |b|^2 - 2 a . b in double precision; infinite where not finite."""
    finite_a, finite_b = (np.asarray(np.isfinite(each).all(axis=1)) for each in (descriptors_a, descriptors_b))
    a = np.where(finite_a[:, None], descriptors_a, 0.0)
    b = np.where(finite_b[:, None], descriptors_b, 0.0)
    squared = (a * a).sum(axis=1)[:, None] + (b * b).sum(axis=1) - 2 * (a @ b.T)
    distance = np.sqrt(np.maximum(squared, 0.0)).astype(np.float32)
    distance[~finite_a] = np.inf
    distance[:, ~finite_b] = np.inf
    return np.asarray(distance)
