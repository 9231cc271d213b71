"""Patch alignment of the matches of several filter chains: a match that many of them keep is aligned once."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from asfm.config import Config
from asfm.frontend.matching.patch_alignment import UNLOCALISED, align_matches
from asfm.geometry.sonar import SonarModel
from asfm.types import Keypoints, Matches


def align_chains(
    chains: Sequence[Sequence[Matches]], keypoints: Sequence[Keypoints], sonar: SonarModel, config: Config
) -> list[list[Matches]]:
    """Align the matches of each chain, with the results of :func:`align_matches`.

    Args:
        chains: matches of the same pairs of frames in the same order, one list a filter chain.
        keypoints: those of every frame, with their patches.
        sonar: the pixel grid.
        config: sections ``localisation`` and ``keypoints``.
    """
    if not config.localisation.radius_px:
        return [list(matches) for matches in chains]
    unions = [_join(pairs) for pairs in zip(*chains, strict=True)]
    aligned = align_matches(unions, keypoints, sonar, config)
    return [
        [_look_up(match, union, result) for match, union, result in zip(matches, unions, aligned, strict=True)]
        for matches in chains
    ]


def _join(pairs: Sequence[Matches]) -> Matches:
    """Return all different matches of one pair of frames, sorted."""
    index = np.unique(np.concatenate([pair.index for pair in pairs]), axis=0)
    return Matches(pairs[0].frame_a, pairs[0].frame_b, index, np.zeros(len(index)))


def _look_up(match: Matches, union: Matches, aligned: Matches) -> Matches:
    """Give a chain's matches their standard deviations, and reject those that are not localised."""
    if not len(match):
        return match
    row = _find_rows(union, match)
    localised = np.zeros(len(union), dtype=bool)
    sigma = np.full((len(union), 2), np.nan)
    if aligned.sigma is not None:
        kept = _find_rows(union, aligned)
        localised[kept], sigma[kept] = True, aligned.sigma
    return replace(match, sigma=sigma[row]).reject(~localised[row], UNLOCALISED)


def _find_rows(union: Matches, match: Matches) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Return the rows (M,) of a pair's matches among all different ones, which are sorted."""
    width = int(union.index[:, 1].max(initial=0)) + 1
    return np.searchsorted(union.index @ [width, 1], match.index @ [width, 1])
