"""NearestNeighbours descriptors of two frames: Hamming distance of binary ones, Euclidean distance of others."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from asfm.config import MatchingConfig
from asfm.errors import AsfmError
from asfm.types import BoolArray, FloatArray, IntArray, Keypoints

Descriptors = NDArray[np.uint8] | NDArray[np.float32]


@dataclass(frozen=True)
class NearestNeighbours:
    """Each keypoint of frame a that has somebody to compare with, and its nearest keypoint of frame b."""

    index: IntArray
    """(M, 2) keypoint of frame a (rising), keypoint of frame b."""
    ratio: FloatArray
    """(M,) nearest distance over second nearest, 0..1; 1 where two are equally near, equal descriptors included."""
    mutual: BoolArray
    """(M,) whether the first is also the nearest of the second."""


def match_keypoints(frame_a: Keypoints, frame_b: Keypoints, config: MatchingConfig) -> tuple[IntArray, FloatArray]:
    """Match keypoints that are each other's nearest, clearly nearer than the second nearest.

    Returns:
        (M, 2) indices into frame_a and frame_b, and (M,) the ratio nearest / second nearest (smaller is surer).
    """
    nearest = find_nearest_neighbours(frame_a, frame_b)
    keep = nearest.mutual & (nearest.ratio <= config.ratio)
    return nearest.index[keep], nearest.ratio[keep]


def find_nearest_neighbours(
    frame_a: Keypoints, frame_b: Keypoints, allowed: BoolArray | None = None
) -> NearestNeighbours:
    """Find the nearest descriptor of frame b for each of frame a, among those allowed.

    Where only one is allowed there is no second nearest: the one is then compared with the mean distance to everybody,
    for even a lone candidate must be nearer than strangers are. Descriptors that are not finite are nobody's nearest.

    Args:
        frame_a, frame_b: fewer than two keypoints in either leave nothing to compare, and no match.
        allowed: (Ka, Kb) which pairs are possible; every one without.

    Raises:
        AsfmError: the descriptors are of two kinds or lengths.
    """
    if len(frame_a) < 2 or len(frame_b) < 2:
        return NearestNeighbours(np.zeros((0, 2), dtype=np.int64), np.zeros(0), np.zeros(0, dtype=bool))
    distance = descriptor_distances(frame_a.descriptors, frame_b.descriptors)
    stranger = np.full(len(frame_a), np.inf, dtype=np.float32)
    if allowed is not None:
        stranger = distance.mean(axis=1)
        np.copyto(distance, np.float32(np.inf), where=~allowed)
    rows = np.arange(len(frame_a))
    nearest = distance.argmin(axis=1)
    first = distance[rows, nearest]
    mutual = distance.argmin(axis=0)[nearest] == rows
    distance[rows, nearest] = np.inf
    second = distance[rows, distance.argmin(axis=1)]
    second = np.where(np.isfinite(second), second, stranger)
    known = np.isfinite(first) & np.isfinite(second)
    first, second = first[known].astype(float), second[known].astype(float)
    ratio = np.where(second > first, first / np.where(second > 0, second, 1.0), 1.0)
    return NearestNeighbours(np.stack([rows[known], nearest[known]], axis=1), ratio, mutual[known])


def descriptor_distances(descriptors_a: Descriptors, descriptors_b: Descriptors) -> NDArray[np.float32]:
    """Compare each of (Ka, D) with each of (Kb, D) descriptors: (Ka, Kb), infinite where one is not finite.

    Bytes are binary descriptors and are compared by Hamming distance, floats by Euclidean distance.

    Raises:
        AsfmError: the descriptors are of two kinds or lengths.
    """
    binary = [descriptors.dtype == np.uint8 for descriptors in (descriptors_a, descriptors_b)]
    if binary[0] != binary[1] or descriptors_a.shape[1] != descriptors_b.shape[1]:
        found = [f"{each.dtype} of length {each.shape[1]}" for each in (descriptors_a, descriptors_b)]
        raise AsfmError(
            f"matching: expected descriptors of one kind and length, found {found[0]} and {found[1]}; "
            "detect the keypoints of every frame with one detector"
        )
    if binary[0]:
        return _count_bits(descriptors_a.astype(np.uint8, copy=False), descriptors_b.astype(np.uint8, copy=False))
    return _euclidean_distances(np.asarray(descriptors_a, dtype=float), np.asarray(descriptors_b, dtype=float))


def hamming_distances(descriptors_a: NDArray[np.uint8], descriptors_b: NDArray[np.uint8]) -> IntArray:
    """Count the bits that differ between each of (Ka, D) and each of (Kb, D) binary descriptors: (Ka, Kb)."""
    return _count_bits(descriptors_a, descriptors_b).astype(np.int64)


def _count_bits(descriptors_a: NDArray[np.uint8], descriptors_b: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Count differing bits, eight bytes at a time, in memory that is taken once."""
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
    """Pack (K, D) bytes into (K, ceil(D / 8)) words, filled up with zeros."""
    padded = np.zeros((len(descriptors), -(-descriptors.shape[1] // 8) * 8), dtype=np.uint8)
    padded[:, : descriptors.shape[1]] = descriptors
    return padded.view(np.uint64)


def _euclidean_distances(descriptors_a: FloatArray, descriptors_b: FloatArray) -> NDArray[np.float32]:
    """Euclidean distances by |a|^2 + |b|^2 - 2 a . b in double precision; infinite where one is not finite."""
    finite_a, finite_b = (np.asarray(np.isfinite(each).all(axis=1)) for each in (descriptors_a, descriptors_b))
    a = np.where(finite_a[:, None], descriptors_a, 0.0)
    b = np.where(finite_b[:, None], descriptors_b, 0.0)
    squared = (a * a).sum(axis=1)[:, None] + (b * b).sum(axis=1) - 2 * (a @ b.T)
    distance = np.sqrt(np.maximum(squared, 0.0)).astype(np.float32)
    distance[~finite_a] = np.inf
    distance[:, ~finite_b] = np.inf
    return np.asarray(distance)
