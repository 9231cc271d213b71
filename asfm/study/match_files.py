"""Files of keypoints and matches in a study's cache: NumPy archives of plain arrays."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from asfm.types import Keypoints, Matches

FIELDS = ("row_column", "range_m", "bearing_rad", "response", "descriptors")


def write_keypoints(path: Path, keypoints: Sequence[Keypoints]) -> None:
    """Write the keypoints of all frames, without patches."""
    counts = np.array([len(frame) for frame in keypoints], dtype=np.int64)
    columns = {name: np.concatenate([getattr(frame, name) for frame in keypoints]) for name in FIELDS}
    arrays: dict[str, Any] = {"counts": counts, **columns}
    np.savez(path, **arrays)


def read_keypoints(path: Path) -> list[Keypoints]:
    """Read the keypoints of all frames."""
    with np.load(path, allow_pickle=False) as file:
        ends = np.cumsum(file["counts"])[:-1]
        columns = [np.split(file[name], ends)[: len(ends) + 1] for name in FIELDS]
    no_patches = np.zeros((0, 1, 1), dtype=np.float32)
    return [
        Keypoints(row_column, range_m, bearing_rad, response, descriptors, no_patches)
        for row_column, range_m, bearing_rad, response, descriptors in zip(*columns, strict=True)
    ]


def write_matches(path: Path, matches: Sequence[Matches]) -> None:
    """Write the matches of all pairs of frames; those that filters rejected are left out."""
    stated = [match.sigma for match in matches if match.sigma is not None]
    np.savez(
        path,
        frames=np.array([(match.frame_a, match.frame_b) for match in matches], dtype=np.int64).reshape(-1, 2),
        counts=np.array([len(match) for match in matches], dtype=np.int64),
        index=np.concatenate([np.zeros((0, 2), dtype=np.int64), *(match.index for match in matches)]),
        cost=np.concatenate([np.zeros(0), *(match.cost for match in matches)]),
        has_sigma=np.array([match.sigma is not None for match in matches], dtype=bool),
        sigma=np.concatenate([np.zeros((0, 2)), *stated]),
    )


def read_matches(path: Path) -> list[Matches]:
    """Read the matches of all pairs of frames."""
    with np.load(path, allow_pickle=False) as file:
        frames, counts, has_sigma = file["frames"].tolist(), file["counts"], file["has_sigma"]
        index, cost = (np.split(file[name], np.cumsum(counts)[:-1])[: len(counts)] for name in ("index", "cost"))
        sigma = iter(np.split(file["sigma"], np.cumsum(counts[has_sigma])[:-1]))
    return [
        Matches(a, b, pair_index, pair_cost, sigma=next(sigma) if stated else None)
        for (a, b), stated, pair_index, pair_cost in zip(frames, has_sigma, index, cost, strict=True)
    ]
