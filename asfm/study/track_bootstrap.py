"""Bootstrap over tracks: the perturbation that gives a recording, which has one noise only, a spread of results."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from asfm.frontend.tracking.track_builder import build_tracks
from asfm.types import BoolArray, Keypoints, Matches

KEPT_SHARE = 1 - float(np.exp(-1))
"""Share of different tracks in a bootstrap sample of many (Efron 1979). Repeated tracks have no greater weight here."""


def resample_tracks(
    keypoints: Sequence[Keypoints], matches: Sequence[Matches], rng: np.random.Generator
) -> tuple[list[Keypoints], list[Matches]]:
    """Keep a random share of the tracks; the keypoints of the others are removed, so that nothing can bring them back.

    Args:
        keypoints: those of every frame, without patches.
        matches: of any pairs of frames.
        rng: draws the tracks.
    """
    tracks = build_tracks(keypoints, matches)
    assert tracks.keypoint is not None
    kept = [rng.random(len(frame)) < KEPT_SHARE for frame in keypoints]  # keypoints that are in no track
    chosen = rng.random(tracks.count) < KEPT_SHARE
    for frame, rows in enumerate(tracks.by_frame(len(keypoints))):
        kept[frame][tracks.keypoint[rows]] = chosen[tracks.track[rows]]
    return [_take(frame, which) for frame, which in zip(keypoints, kept, strict=True)], [
        _renumber(match, kept[match.frame_a], kept[match.frame_b]) for match in matches
    ]


def _take(keypoints: Keypoints, which: BoolArray) -> Keypoints:
    columns = ("row_column", "range_m", "bearing_rad", "response", "descriptors")
    return replace(keypoints.without_patches(), **{name: getattr(keypoints, name)[which] for name in columns})


def _renumber(match: Matches, kept_a: BoolArray, kept_b: BoolArray) -> Matches:
    """Return the matches of which both keypoints are kept, with their new indices."""
    both = kept_a[match.index[:, 0]] & kept_b[match.index[:, 1]]
    new = [np.cumsum(kept)[match.index[both, side]] - 1 for side, kept in enumerate((kept_a, kept_b))]
    return Matches(
        match.frame_a,
        match.frame_b,
        np.stack(new, axis=1).astype(np.int64),
        match.cost[both],
        sigma=None if match.sigma is None else match.sigma[both],
    )
