"""Hamming matching of two frames' keypoints with the ratio test and the mutual test."""

import numpy as np
from numpy.typing import NDArray

from asfm.config import MatchingConfig
from asfm.types import FloatArray, IntArray, Keypoints


def match_keypoints(frame_a: Keypoints, frame_b: Keypoints, config: MatchingConfig) -> tuple[IntArray, FloatArray]:
    """Match keypoints that are each other's nearest by Hamming distance, clearly nearer than the second nearest.

    Returns:
        (M, 2) indices into frame_a and frame_b, and (M,) the ratio nearest / second nearest (smaller is surer).
    """
    if len(frame_a) < 2 or len(frame_b) < 2:
        return np.zeros((0, 2), dtype=np.int64), np.zeros(0)
    distance = hamming_distances(frame_a.descriptors, frame_b.descriptors).astype(np.float64)
    nearest = np.argmin(distance, axis=1)
    rows = np.arange(len(frame_a))
    first = distance[rows, nearest]
    mutual = np.argmin(distance, axis=0)[nearest] == rows
    distance[rows, nearest] = np.inf
    ratio = first / np.maximum(distance.min(axis=1), 1.0)
    keep = mutual & (ratio <= config.ratio)
    return np.stack([rows[keep], nearest[keep]], axis=1).astype(np.int64), ratio[keep]


def hamming_distances(descriptors_a: NDArray[np.uint8], descriptors_b: NDArray[np.uint8]) -> IntArray:
    """Count the bits that differ between each of (Ka, D) and each of (Kb, D) binary descriptors: (Ka, Kb)."""
    words_a, words_b = _as_words(descriptors_a), _as_words(descriptors_b)
    distance = np.zeros((len(words_a), len(words_b)), dtype=np.int64)
    for word in range(words_a.shape[1]):
        distance += np.bitwise_count(words_a[:, word, None] ^ words_b[None, :, word])
    return distance


def _as_words(descriptors: NDArray[np.uint8]) -> NDArray[np.uint64]:
    """Pack (K, D) bytes into (K, ceil(D / 8)) words, filled up with zeros."""
    padded = np.zeros((len(descriptors), -(-descriptors.shape[1] // 8) * 8), dtype=np.uint8)
    padded[:, : descriptors.shape[1]] = descriptors
    return padded.view(np.uint64)
