"""Subdivision of triangles to a largest edge, so that faces can carry texture."""

import numpy as np

from asfm.types import BoolArray, FloatArray, IntArray

MAX_ROUNDS = 80
SPARE = 0.95
"""Strips are cut a little shorter, since their diagonal is longer."""


def count_quarters(vertices_m: FloatArray, faces: IntArray, edge_m: float) -> float:
    """Return how many faces there are once each is quartered until no edge is longer than ``edge_m``."""
    longest_m = _edge_lengths(vertices_m[faces]).max(axis=1)
    levels = np.ceil(np.log2(np.maximum(longest_m / edge_m, 1.0)))
    return float((4.0**levels).sum())


def cut_long_faces(
    vertices_m: FloatArray, faces: IntArray, edge_m: float, max_faces: int
) -> tuple[FloatArray, IntArray]:
    """Cut faces until no edge is longer than ``edge_m``: narrow ones across their length, others at the longest edge.

    The number of pieces of a narrow face grows with length over edge, whereas quartering lets it grow with the square.

    Args:
        vertices_m: (V, 3)
        faces: (F, 3) vertex indices.
        edge_m: largest edge; doubled as often as needed to stay below ``max_faces``.
        max_faces: largest number of faces.

    Returns:
        Vertices and faces; a face keeps its winding, and shares no vertex with another.
    """
    corners = vertices_m[faces]
    for _ in range(MAX_ROUNDS):
        lengths_m = _edge_lengths(corners)
        long = lengths_m.max(axis=1) > edge_m
        if not long.any():
            break
        narrow = long & (lengths_m.min(axis=1) <= edge_m)
        pieces = np.where(narrow, np.ceil(lengths_m.max(axis=1) / (SPARE * edge_m)), 1.0)
        if len(corners) + long.sum() + 2 * pieces[narrow].sum() > max_faces:
            edge_m *= 2
            continue
        corners = _cut_once(corners, lengths_m, (long & ~narrow, narrow), pieces)
    return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)


def _cut_once(
    corners: FloatArray, lengths_m: FloatArray, kinds: tuple[BoolArray, BoolArray], pieces: FloatArray
) -> FloatArray:
    """Halve the faces (F, 3, 3) of the first kind, and cut those of the second into strips."""
    wide, narrow = kinds
    a, b, c = _rotate(corners[wide], lengths_m[wide].argmax(axis=1))  # the longest edge runs from a to b
    middle = 0.5 * (a + b)
    halves = [np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)]
    count = pieces[narrow].astype(np.int64)
    c, a, b = _rotate(corners[narrow], lengths_m[narrow].argmin(axis=1))  # the shortest edge runs from c to a
    face = np.repeat(np.arange(len(count)), count)
    step = np.arange(len(face)) - np.repeat(np.cumsum(count) - count, count)
    low, high = (step / count[face])[:, None], ((step + 1) / count[face])[:, None]
    p, q, p_next, q_next = (start + share * (b[face] - start) for share in (low, high) for start in (a[face], c[face]))
    is_tip = step + 1 == count[face]
    strips = [np.stack([q, p, p_next], axis=1), np.stack([q, p_next, q_next], axis=1)[~is_tip]]
    return np.concatenate([corners[~(wide | narrow)], *halves, *strips])


def _rotate(corners: FloatArray, first: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the corners of faces (F, 3, 3), each (F, 3), from a given one on."""
    row = np.arange(len(corners))
    one, two, three = (corners[row, (first + shift) % 3] for shift in range(3))
    return one, two, three


def _edge_lengths(corners: FloatArray) -> FloatArray:
    """Return (F, 3) lengths: edge i of a face runs from its corner i to the next."""
    return np.asarray(np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2))
