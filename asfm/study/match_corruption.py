"""Controlled corruption: true matches with stated noise, wrong partners, recall and track length."""

from dataclasses import dataclass

import numpy as np

from asfm.geometry.sonar import SonarModel
from asfm.study.cell import Corruption
from asfm.study.true_tracks import TrueTracks
from asfm.types import ExternalMatches, FloatArray, IntArray, Keypoints, Matches


@dataclass(frozen=True)
class CorruptedMatches:
    """Matches of known quality."""

    external: ExternalMatches
    precision: float | None
    """Share of the matches that join observations of one point; None without matches."""
    recall: float | None
    """Share of the true matches that are among them; None without true matches."""


def corrupt_matches(
    tracks: TrueTracks,
    sonar: SonarModel,
    corruption: Corruption,
    frames: int,
    max_gap: int,
    rng: np.random.Generator,
) -> CorruptedMatches:
    """Make keypoints and matches of the stated quality from true tracks.

    In each pair of frames a share of the true matches is kept, and of those a share gets a wrong partner. A keypoint
    has one position in all of its matches.

    Args:
        tracks: exact observations.
        sonar: pixel grid, the unit of the noise.
        corruption: setting of every dial.
        frames: number of frames.
        max_gap: largest gap of two matched frames.
        rng: draws noise, the matches that are lost, and the wrong ones.
    """
    range_m, bearing_rad = _add_noise(tracks, sonar, corruption, rng)
    first = np.searchsorted(tracks.track, tracks.track)
    age = tracks.frame - tracks.frame[first]
    piece = age // (corruption.track_length or frames)
    identity = np.unique(np.stack([tracks.track, piece], axis=1), axis=0, return_inverse=True)[1].ravel()
    order = np.argsort(tracks.frame, kind="stable")
    of_frame = np.split(order, np.searchsorted(tracks.frame[order], np.arange(1, frames)))
    keypoints = tuple(_make_keypoints(range_m[rows], bearing_rad[rows], sonar) for rows in of_frame)
    matches, true, correct = [], 0, 0
    for b in range(frames):
        for a in range(max(0, b - max_gap), b):
            sides = of_frame[a], of_frame[b]
            index = _match_pair(identity[sides[0]], identity[sides[1]], keypoints[b], corruption, rng)
            true += len(np.intersect1d(tracks.track[sides[0]], tracks.track[sides[1]]))
            correct += int((tracks.track[sides[0]][index[:, 0]] == tracks.track[sides[1]][index[:, 1]]).sum())
            matches.append(Matches(a, b, index, np.full(len(index), 0.5)))
    total, external = sum(len(match) for match in matches), ExternalMatches(keypoints, tuple(matches))
    return CorruptedMatches(external, correct / total if total else None, correct / true if true else None)


def _match_pair(
    identity_a: IntArray, identity_b: IntArray, keypoints_b: Keypoints, corruption: Corruption, rng: np.random.Generator
) -> IntArray:
    """Return the matches (M, 2) of two frames whose keypoints have (Ka,) and (Kb,) identities."""
    _, in_a, in_b = np.intersect1d(identity_a, identity_b, return_indices=True)
    kept = rng.permutation(len(in_a))[: _round(corruption.recall * len(in_a), rng)]
    index = np.stack([in_a[kept], in_b[kept]], axis=1).astype(np.int64)
    return swap_partners(index, keypoints_b.row_column, corruption, rng)


def swap_partners(
    index: IntArray, row_column_b: FloatArray, corruption: Corruption, rng: np.random.Generator
) -> IntArray:
    """Swap the partners of a share of the matches of one pair of frames for wrong ones.

    Every partner stays taken once. A random swap moves the partners of all chosen matches round; a look-alike swap
    exchanges those of the chosen match and of the one whose partner is nearest in the image.

    Args:
        index: (M, 2) true matches.
        row_column_b: (K, 2) positions of the second frame's keypoints in pixels.
        corruption: share and kind.
        rng: draws the matches.

    Returns:
        (M, 2) with that share wrong, to the nearest possible number.
    """
    if corruption.wrong_kind == "random":
        wrong = _round(corruption.wrong_share * len(index), rng)
        wrong = 2 * int(rng.random() < 0.5) if wrong == 1 else wrong  # no match can be wrong alone
        chosen = rng.permutation(len(index))[: wrong if wrong <= len(index) else 0]
        swapped = index.copy()
        swapped[chosen, 1] = index[np.roll(chosen, 1), 1]
        return swapped
    return _swap_with_nearest(index, row_column_b, _round(corruption.wrong_share * len(index) / 2, rng), rng)


def _swap_with_nearest(index: IntArray, row_column_b: FloatArray, swaps: int, rng: np.random.Generator) -> IntArray:
    """Exchange the partners of random matches and of those whose partner is nearest to theirs; each match once."""
    swapped, free, position = index.copy(), np.ones(len(index), dtype=bool), row_column_b[index[:, 1]]
    for match in rng.permutation(len(index)).tolist():
        if swaps and free[match] and free.sum() >= 2:
            free[match] = False
            distance_px = np.where(free, np.linalg.norm(position - position[match], axis=1), np.inf)
            other = int(distance_px.argmin())
            free[other], swaps = False, swaps - 1
            swapped[[match, other], 1] = index[[other, match], 1]
    return swapped


def _add_noise(
    tracks: TrueTracks, sonar: SonarModel, corruption: Corruption, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Return range_m (O,) and bearing_rad (O,) with noise, independent at each observation or one value a track."""
    number = tracks.track if corruption.noise_kind == "track" else np.arange(len(tracks.track))
    noise = rng.standard_normal((int(number.max(initial=-1)) + 1, 2))[number]
    range_m = tracks.range_m + corruption.range_noise_bins * sonar.range_step_m * noise[:, 0]
    bearing_rad = tracks.bearing_rad + corruption.bearing_noise_beams * sonar.bearing_step_rad * noise[:, 1]
    low_m, high_m = sonar.range_edges_m[[0, -1]]
    return np.clip(range_m, max(low_m, 1e-3), high_m), np.clip(bearing_rad, *sonar.bearing_edges_rad[[0, -1]])


def _make_keypoints(range_m: FloatArray, bearing_rad: FloatArray, sonar: SonarModel) -> Keypoints:
    row_column = np.stack([sonar.row_at_range(range_m), sonar.column_at_bearing(bearing_rad)], axis=1)
    return Keypoints(
        row_column=row_column,
        range_m=range_m,
        bearing_rad=bearing_rad,
        response=np.ones(len(range_m)),
        descriptors=np.zeros((len(range_m), 0), dtype=np.float32),
        patches=np.zeros((0, 1, 1), dtype=np.float32),
    )


def _round(value: float, rng: np.random.Generator) -> int:
    """Round to a neighbouring whole number whose mean is the value."""
    return int(np.floor(value + rng.random())) if value % 1 else int(value)
