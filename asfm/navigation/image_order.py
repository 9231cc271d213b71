"""Order of images: frames that resemble the second or third next frame far more than the next one.

A sonar moves on, so that the next frame shares more with a frame than later ones do. Frames that were shuffled, or
sorted by name as text (1, 10, 11, 2), break this rule. No odometry is needed.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from asfm.diagnostics import Diagnostic, format_runs, frame_runs
from asfm.geometry.sonar import back_project
from asfm.types import BoolArray, FloatArray, Keypoints, Matches

LATER_GAPS = (2, 3)
"""Frames from a frame to those that it is compared with, beside the next one."""
MORE_MATCHES, MIN_MORE_MATCHES = 2.0, 10
"""A later frame shares far more when its matches exceed this multiple of those with the next frame, plus so many."""
LESS_MOTION, MIN_MATCHES = 0.5, 10
"""A later frame lies far nearer when its features moved by less than this share of those in the next one; and the
matches that this takes."""
MIN_MOTION_SIGMAS = 4.0
"""Smaller motions to the next frame are noise: the order of images of a sonar at rest cannot be seen."""
MIN_FRAMES = 2
"""A single frame may be like that by chance."""


def find_misplaced_frames(
    keypoints: Sequence[Keypoints], candidates: Iterable[Matches], feature_sigma: FloatArray
) -> BoolArray:
    """Find the frames after which the order of the images is broken.

    Args:
        keypoints: those of the N frames.
        candidates: matches of pairs of frames, made without odometry.
        feature_sigma: (2,) standard deviations of range_m and bearing_rad.

    Returns:
        (N,) which frames resemble a later frame far more than the next one; none where a single one does.
    """
    by_pair = {(matches.frame_a, matches.frame_b): matches for matches in candidates}
    misplaced = np.zeros(len(keypoints), dtype=bool)
    for frame in range(len(keypoints) - 1):
        following = by_pair.get((frame, frame + 1))
        if following is None:
            continue
        motion_m = _median_motion_m(following, keypoints)
        if motion_m < MIN_MOTION_SIGMAS * _noise_m(keypoints[frame], feature_sigma):
            continue
        later = [by_pair[pair] for gap in LATER_GAPS if (pair := (frame, frame + gap)) in by_pair]
        misplaced[frame] = any(
            len(matches) > MORE_MATCHES * len(following) + MIN_MORE_MATCHES
            or (len(matches) >= MIN_MATCHES and _median_motion_m(matches, keypoints) < LESS_MOTION * motion_m)
            for matches in later
        )
    return misplaced if np.count_nonzero(misplaced) >= MIN_FRAMES else np.zeros_like(misplaced)


def diagnose_image_order(misplaced: BoolArray) -> tuple[Diagnostic, ...]:
    """Report the frames (N,) after which the order of the images is broken."""
    if not misplaced.any():
        return ()
    runs = frame_runs(misplaced)
    message = (
        f"{int(misplaced.sum())} of {len(misplaced)} images ({format_runs(runs)}) resemble the second or third next "
        "one far more than the next one: the images seem to be in another order than their stamps say (names sorted as "
        "text?), or single images are spoilt; check them"
    )
    return (Diagnostic("image-order", message, runs),)


def _median_motion_m(matches: Matches, keypoints: Sequence[Keypoints]) -> float:
    """Return the median distance between matched features at elevation zero; infinite without matches."""
    if not len(matches):
        return np.inf
    one, other = keypoints[matches.frame_a], keypoints[matches.frame_b]
    level_m = [back_project(frame.range_m, frame.bearing_rad, 0.0) for frame in (one, other)]
    moved_m = level_m[1][matches.index[:, 1]] - level_m[0][matches.index[:, 0]]
    return float(np.median(np.linalg.norm(moved_m, axis=1)))


def _noise_m(keypoints: Keypoints, feature_sigma: FloatArray) -> float:
    """Return the standard deviation of a typical feature's position."""
    range_m = float(np.median(keypoints.range_m)) if len(keypoints) else 0.0
    return float(np.hypot(feature_sigma[0], feature_sigma[1] * range_m))
