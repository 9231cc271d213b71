"""Outlier filters of matches: mutual, ratio, structural-and-spatial loss, elevation arc, planar motion, clique.

Each takes any number of frame pairs and tests the matches of each on their own; filters run alone or in any order.
"""

from collections.abc import Callable, Sequence

import numpy as np

from asfm.config import Config
from asfm.frontend.features.patches import crop_patches
from asfm.frontend.matching.frame_pair import FramePair
from asfm.frontend.matching.pairwise_consistency import find_distance_outliers
from asfm.frontend.matching.planar_ransac import find_planar_outliers, planar_positions, planar_tolerance_m
from asfm.frontend.matching.ssl import structural_spatial_loss
from asfm.geometry.elevation_arcs import arc_distances
from asfm.geometry.feature_noise import relative_position_noise_m
from asfm.types import BoolArray, FloatArray

FilterResult = tuple[BoolArray, FloatArray]
"""(M,) which matches of a pair pass, (M,) what is added to each match's cost."""
PairFilter = Callable[[Sequence[FramePair], Config], list[FilterResult]]


def filter_mutual(pairs: Sequence[FramePair], _config: Config) -> list[FilterResult]:
    """Pass matches that are each other's nearest neighbour."""
    return [_at_no_cost(pair.nearest.mutual) for pair in pairs]


def filter_ratio(pairs: Sequence[FramePair], config: Config) -> list[FilterResult]:
    """Pass matches clearly nearer than the second nearest (Lowe 2004)."""
    return [_at_no_cost(pair.nearest.ratio <= config.matching.ratio) for pair in pairs]


def filter_ssl(pairs: Sequence[FramePair], config: Config) -> list[FilterResult]:
    """Pass matches with similar patches; the structural-and-spatial loss is added to their cost."""
    missing = [
        pair if pair.ssl_loss is None else pair.take(np.isnan(pair.ssl_loss[pair.index[:, 0]])) for pair in pairs
    ]
    losses = []
    for pair, part, loss in zip(pairs, missing, _measure_ssl(missing, config), strict=True):
        if pair.ssl_loss is not None:
            pair.ssl_loss[part.index[:, 0]] = loss
            loss = pair.ssl_loss[pair.index[:, 0]]
        losses.append(loss)
    return [(loss <= config.ssl.max_loss, loss) for loss in losses]


def _measure_ssl(pairs: Sequence[FramePair], config: Config) -> list[FloatArray]:
    """Return the losses (M,) of the matches of each pair."""
    if not pairs:
        return []
    radius_px = config.ssl.radius_px
    patches_a = np.concatenate([crop_patches(pair.keypoints_a.patches, radius_px)[pair.index[:, 0]] for pair in pairs])
    patches_b = np.concatenate([crop_patches(pair.keypoints_b.patches, radius_px)[pair.index[:, 1]] for pair in pairs])
    loss = structural_spatial_loss(patches_a, patches_b, config.ssl)
    return np.split(loss, np.cumsum([len(pair) for pair in pairs])[:-1])


def filter_arc(pairs: Sequence[FramePair], config: Config) -> list[FilterResult]:
    """Pass matches near their elevation arc under the predicted poses; all where there is no prediction."""
    return [_at_no_cost(_arc_inliers(pair, config)) for pair in pairs]


def filter_planar(pairs: Sequence[FramePair], config: Config) -> list[FilterResult]:
    """Pass matches that agree on one planar motion, up to noise and unknown elevations."""
    return [_at_no_cost(_planar_inliers(pair, config)) for pair in pairs]


def filter_clique(pairs: Sequence[FramePair], config: Config) -> list[FilterResult]:
    """Pass the largest set of matches whose distances are pairwise consistent (Mangelson 2018)."""
    return [_at_no_cost(_clique_inliers(pair, config)) for pair in pairs]


def _at_no_cost(passes: BoolArray) -> FilterResult:
    return passes, np.zeros(len(passes))


def _arc_inliers(pair: FramePair, config: Config) -> BoolArray:
    if pair.arcs is None or pair.sigma is None:
        return np.ones(len(pair), dtype=bool)
    a = pair.index[:, 0]
    return np.asarray(arc_distances(pair.arcs[a], pair.pixels()[1], pair.sigma[a]) <= config.matching.arc_gate)


def _planar_inliers(pair: FramePair, config: Config) -> BoolArray:
    a, b = pair.index.T
    tolerance_m = planar_tolerance_m(pair.keypoints_b.range_m[b], pair.sonar, config)
    xy_a, xy_b = planar_positions(pair.keypoints_a, a), planar_positions(pair.keypoints_b, b)
    _, outlier = find_planar_outliers(xy_a, xy_b, tolerance_m, pair.nearest.ratio)
    return ~outlier


def _clique_inliers(pair: FramePair, config: Config) -> BoolArray:
    pixel_a, pixel_b = pair.pixels()
    slack_m = relative_position_noise_m(pixel_b[:, 0], pair.sonar, config.noise)
    return ~find_distance_outliers(pixel_a, pixel_b, pair.sonar.elevation_aperture_rad, slack_m)


FILTERS: dict[str, PairFilter] = {
    "mutual": filter_mutual,
    "ratio": filter_ratio,
    "ssl": filter_ssl,
    "arc": filter_arc,
    "planar": filter_planar,
    "clique": filter_clique,
}
