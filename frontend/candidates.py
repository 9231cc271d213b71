"""Candidate matches: every frame with those before it, cleaned by the structural-and-spatial loss."""

from collections.abc import Sequence

from asfm.config import Config
from asfm.frontend.matching import match_keypoints
from asfm.frontend.ssl import structural_spatial_loss
from asfm.types import Keypoints, Matches


def match_frames(frame_a: int, frame_b: int, keypoints: Sequence[Keypoints], config: Config) -> Matches:
    """Match two frames: nearest descriptors, ratio and mutual test, then the structural-and-spatial loss.

    The cost of a match is the sum of its ratio and its loss: it ranks matches when tracks are built.
    """
    a, b = keypoints[frame_a], keypoints[frame_b]
    index, ratio = match_keypoints(a, b, config.matching)
    loss = structural_spatial_loss(a.patches[index[:, 0]], b.patches[index[:, 1]], config.ssl)
    keep = loss <= config.ssl.max_loss
    return Matches(frame_a, frame_b, index[keep], (ratio + loss)[keep])


def match_with_previous(frame: int, keypoints: Sequence[Keypoints], config: Config) -> list[Matches]:
    """Match a frame with each of the frames 1..max_gap before it, nearest first."""
    earliest = max(0, frame - config.matching.max_gap)
    return [match_frames(other, frame, keypoints, config) for other in range(frame - 1, earliest - 1, -1)]
