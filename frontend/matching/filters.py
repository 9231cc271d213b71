"""Outlier filters: each judges the matches of one pair of frames, alone or after others, in any order."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from asfm.config import Config, NoiseConfig
from asfm.errors import AsfmError
from asfm.frontend.features.patches import crop_patches
from asfm.frontend.matching.nearest import NearestNeighbours
from asfm.frontend.matching.pairwise_consistency import find_distance_outliers
from asfm.frontend.matching.planar_ransac import find_planar_outliers, place_in_plane
from asfm.frontend.matching.ssl import structural_spatial_loss
from asfm.geometry.elevation_arcs import arc_distances
from asfm.geometry.sonar import SonarModel, feature_sigma
from asfm.types import BoolArray, FloatArray, IntArray, Keypoints, Matches


@dataclass(frozen=True)
class FramePair:
    """What is known of two frames and of the matches proposed between them."""

    keypoints_a: Keypoints
    keypoints_b: Keypoints
    nearest: NearestNeighbours
    """(M,) matches, their ratios, and whether they are mutual."""
    sonar: SonarModel | None = None
    arcs: FloatArray | None = None
    """(Ka, G, 2) range_m and bearing_rad of frame a's elevation arcs as predicted in frame b; None without poses."""
    sigma: FloatArray | None = None
    """(Ka, 2) standard deviations of that prediction and of a keypoint's place, in range_m and bearing_rad."""

    def __len__(self) -> int:
        return len(self.nearest.index)

    @property
    def index(self) -> IntArray:
        """(M, 2) keypoint of frame a, keypoint of frame b."""
        return self.nearest.index

    def pixels(self) -> tuple[FloatArray, FloatArray]:
        """Give range_m and bearing_rad of the matches in both frames, each (M, 2)."""
        sides = zip((self.keypoints_a, self.keypoints_b), self.index.T, strict=True)
        a, b = (np.stack([frame.range_m[which], frame.bearing_rad[which]], axis=1) for frame, which in sides)
        return a, b

    def take(self, which: BoolArray) -> "FramePair":
        """Give the same pair with some of its matches."""
        old = self.nearest
        nearest = NearestNeighbours(old.index[which], old.ratio[which], old.mutual[which])
        return FramePair(self.keypoints_a, self.keypoints_b, nearest, self.sonar, self.arcs, self.sigma)


NOBODY = np.zeros((0, 2), dtype=np.int32)

FilterResult = tuple[BoolArray, FloatArray]
"""(M,) which matches pass, (M,) what each match's cost rises by."""


def filter_matches(pair: FramePair, frame_a: int, frame_b: int, config: Config) -> Matches:
    """Filter the matches of one pair of frames. See :func:`filter_pairs`."""
    return filter_pairs([pair], [(frame_a, frame_b)], config)[0]


def filter_pairs(pairs: Sequence[FramePair], frames: Sequence[tuple[int, int]], config: Config) -> list[Matches]:
    """Let the filters of ``matching.filters`` judge in their order, each only what those before it left.

    The cost of a match is its ratio and what the filters add to it: it ranks matches when tracks are built. Every
    rejected match remembers the filter. The pairs do not influence each other.

    Args:
        pairs: what is proposed between pairs of frames.
        frames: the frames' indices, as many.
    """
    left, costs = list(pairs), [pair.nearest.ratio for pair in pairs]
    rejected: list[list[NDArray[np.int32]]] = [[] for _ in pairs]
    for name in config.matching.filters if pairs else ():
        for number, (passes, rise) in enumerate(_judge(name, left, config)):
            rejected[number].append(left[number].index[~passes].astype(np.int32))
            costs[number] = (costs[number] + rise)[passes]
            left[number] = left[number].take(passes)
    return [
        _remember(a, b, pair.index, cost, parts, config.matching.filters)
        for (a, b), pair, cost, parts in zip(frames, left, costs, rejected, strict=True)
    ]


def _judge(name: str, pairs: Sequence[FramePair], config: Config) -> list[FilterResult]:
    """Ask one filter about every pair; the structural-and-spatial loss looks at all patches at once."""
    if name != "ssl":
        return [FILTERS[name](pair, config) for pair in pairs]
    radius_px = config.ssl.radius_px
    patches_a = np.concatenate([crop_patches(pair.keypoints_a.patches, radius_px)[pair.index[:, 0]] for pair in pairs])
    patches_b = np.concatenate([crop_patches(pair.keypoints_b.patches, radius_px)[pair.index[:, 1]] for pair in pairs])
    loss = structural_spatial_loss(patches_a, patches_b, config.ssl)
    ends = np.cumsum([len(pair) for pair in pairs])
    return [(part <= config.ssl.max_loss, part) for part in np.split(loss, ends[:-1])]


def _remember(
    frame_a: int,
    frame_b: int,
    index: IntArray,
    cost: FloatArray,
    rejected: Sequence[NDArray[np.int32]],
    names: tuple[str, ...],
) -> Matches:
    """Join what each filter rejected, in their order."""
    by = np.repeat(np.arange(len(rejected), dtype=np.int8), np.array([len(part) for part in rejected], dtype=np.int64))
    return Matches(frame_a, frame_b, index, cost, np.concatenate([NOBODY, *rejected]), by, names)


def filter_mutual(pair: FramePair, config: Config) -> FilterResult:
    """Pass matches that are each other's nearest."""
    return pair.nearest.mutual, np.zeros(len(pair))


def filter_ratio(pair: FramePair, config: Config) -> FilterResult:
    """Pass matches clearly nearer than the second nearest (Lowe 2004)."""
    return pair.nearest.ratio <= config.matching.ratio, np.zeros(len(pair))


def filter_ssl(pair: FramePair, config: Config) -> FilterResult:
    """Pass matches whose surroundings look alike; their loss is added to their cost."""
    return _judge("ssl", [pair], config)[0]


def filter_arc(pair: FramePair, config: Config) -> FilterResult:
    """Pass matches near their elevation arc under the predicted poses; all where nothing predicts them."""
    if pair.arcs is None or pair.sigma is None:
        return np.ones(len(pair), dtype=bool), np.zeros(len(pair))
    a = pair.index[:, 0]
    residual = arc_distances(pair.arcs[a], pair.pixels()[1], pair.sigma[a])
    return residual <= config.matching.arc_gate, np.zeros(len(pair))


def filter_planar(pair: FramePair, config: Config) -> FilterResult:
    """Pass matches that agree on one planar motion, as far as noise and unknown elevations allow."""
    a, b = pair.index.T
    share = config.matching.planar_tolerance
    tolerance_m = np.maximum(share * pair.keypoints_b.range_m[b], 1e-9)
    if pair.sonar is not None:
        tolerance_m = np.maximum(tolerance_m, _position_noise(pair.sonar, pair.keypoints_b.range_m[b], config))
    xy_a, xy_b = place_in_plane(pair.keypoints_a, a), place_in_plane(pair.keypoints_b, b)
    _, disagrees = find_planar_outliers(xy_a, xy_b, tolerance_m, pair.nearest.ratio)
    return ~disagrees, np.zeros(len(pair))


def filter_clique(pair: FramePair, config: Config) -> FilterResult:
    """Pass the largest set of matches whose lengths agree in pairs.

    Raises:
        AsfmError: the sonar is not known.
    """
    if pair.sonar is None:
        raise AsfmError("matching.filters: 'clique' needs the sonar's aperture; pass the sonar or leave 'clique' out")
    pixel_a, pixel_b = pair.pixels()
    slack_m = _position_noise(pair.sonar, pixel_b[:, 0], config)
    outliers = find_distance_outliers(pixel_a, pixel_b, pair.sonar.elevation_aperture_rad, slack_m)
    return ~outliers, np.zeros(len(pair))


@lru_cache(maxsize=8)
def difference_sigma(sonar: SonarModel, noise: NoiseConfig) -> FloatArray:
    """Standard deviations (2,) of the difference of two features' range_m and bearing_rad. Not to be written to."""
    sigma = np.asarray(feature_sigma(sonar, noise) * np.sqrt(2.0))
    sigma.flags.writeable = False
    return sigma


def _position_noise(sonar: SonarModel, range_m: FloatArray, config: Config) -> FloatArray:
    """How far (M,) the noise of both keypoints of a match may move one against the other: two sigmas."""
    sigma = difference_sigma(sonar, config.noise)
    return np.asarray(2.0 * np.hypot(sigma[0], sigma[1] * range_m))


FILTERS: dict[str, Callable[[FramePair, Config], FilterResult]] = {
    "mutual": filter_mutual,
    "ratio": filter_ratio,
    "ssl": filter_ssl,
    "arc": filter_arc,
    "planar": filter_planar,
    "clique": filter_clique,
}
