"""Outlier filters alone: each rejects wrong matches and keeps correct ones, on a frame pair with known outliers."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from asfm.config import Config, Filter, MatchingConfig, SslConfig
from asfm.config_file import load_config
from asfm.errors import AsfmError
from asfm.frontend.matching.filters import FILTERS
from asfm.frontend.matching.frame_pair import FramePair
from asfm.geometry.feature_noise import feature_sigma
from asfm.geometry.sonar import SonarModel
from asfm.types import FloatArray
from tests.worlds import MATCHING_SONAR, make_frame_pair, make_keypoints, observe_points, random_points

COUNT, WRONG = 60, 12


@pytest.mark.parametrize("name", sorted(FILTERS))
def test_each_filter_rejects_wrong_matches_and_keeps_correct_ones(name: Filter) -> None:
    ((passes, added_cost),) = FILTERS[name]([make_frame_pair()], Config())
    assert passes[WRONG:].all()
    assert np.sum(~passes[:WRONG]) >= (6 if name == "clique" else 10)
    assert passes.shape == added_cost.shape == (COUNT,)
    assert added_cost.any() == (name == "ssl"), "only the loss adds to the cost"


def test_ratio_filter_keeps_ratios_up_to_the_threshold() -> None:
    pair = make_frame_pair()
    for threshold, kept in ((0.59, 0), (0.6, COUNT - WRONG), (0.95, COUNT)):
        ((passes, _),) = FILTERS["ratio"]([pair], Config(matching=MatchingConfig(ratio=threshold)))
        assert passes.sum() == kept


def test_terms_of_the_loss_are_weighted() -> None:
    pair = make_frame_pair()

    def cost(structural: float = 1.0, spatial: float = 1.0) -> FloatArray:
        loss = SslConfig(max_loss=1e6, structural_weight=structural, spatial_weight=spatial)
        ((_, added_cost),) = FILTERS["ssl"]([pair], Config(ssl=loss))
        return added_cost

    structural, spatial = cost(spatial=0.0), cost(structural=0.0)
    assert structural.min() > 0 and spatial.min() > 0
    np.testing.assert_allclose(cost(2.0, 0.5), 2 * structural + 0.5 * spatial)
    assert not cost(0.0, 0.0).any()


def test_arc_filter_passes_all_without_a_prediction() -> None:
    full = make_frame_pair()
    ((passes, _),) = FILTERS["arc"](
        [FramePair(full.keypoints_a, full.keypoints_b, full.nearest, MATCHING_SONAR)], Config()
    )
    assert passes.all()


@pytest.mark.parametrize(("sigmas", "passed"), [(0.95, True), (1.05, False)])
def test_arc_filter_passes_matches_up_to_the_gate(sigmas: float, passed: bool) -> None:
    """All points lie that share of the gate beyond the farthest point of their arc."""
    config, pair = Config(), make_frame_pair(wrong=0)
    assert pair.arcs is not None and pair.sigma is not None
    farthest_m = pair.arcs[..., 0].max(axis=1) + sigmas * config.matching.arc_gate * pair.sigma[:, 0]
    bearing_rad = pair.arcs[np.arange(COUNT), pair.arcs[..., 0].argmax(axis=1), 1]
    beyond = replace(pair, keypoints_b=make_keypoints(farthest_m, bearing_rad))
    ((passes, _),) = FILTERS["arc"]([beyond], config)
    assert passes.mean() > 0.95 if passed else not passes.any()


def test_clique_filter_allows_for_the_noise_of_keypoints_where_elevations_explain_nothing() -> None:
    """Points in the plane of a sonar of hardly any aperture, moved by one standard deviation along the range."""
    rng, config, pair = np.random.default_rng(0), Config(), make_frame_pair(wrong=0)
    flat = SonarModel.evenly_spaced("flat", (0.5, 10.0), (-0.7, 0.7), (600, 256), 1e-4)
    points, sigma_m = random_points(rng, COUNT, (2, 8), 0.6, 0.0), feature_sigma(flat, config.noise)[0]
    a, b = observe_points(points), observe_points(points)
    moved = replace(b, range_m=b.range_m + rng.choice([-sigma_m, sigma_m], COUNT))
    ((passes, _),) = FILTERS["clique"]([replace(pair, keypoints_a=a, keypoints_b=moved, sonar=flat)], config)
    assert passes.all()


def test_every_filter_of_the_configuration_exists() -> None:
    assert set(FILTERS) == set(get_args(Filter))


@pytest.mark.parametrize(
    ("text", "message"), [("[ratio, ratio]", "at most once"), ("[ratio, magic]", "matching.filters"), ("7", "filters")]
)
def test_unknown_or_repeated_filters_are_errors(text: str, message: str) -> None:
    with pytest.raises(AsfmError, match=message) as error:
        load_config(None, (f"matching.filters={text}",))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", ["arc", "planar", "clique"])
def test_positions_that_are_not_finite_are_the_only_outliers(name: Filter) -> None:
    pair = make_frame_pair(wrong=0)
    pair.keypoints_b.range_m[7] = np.nan
    pair.keypoints_b.bearing_rad[9] = np.inf
    with np.errstate(invalid="ignore"):
        ((passes, _),) = FILTERS[name]([pair], Config())
    assert np.flatnonzero(~passes).tolist() == [7, 9]
