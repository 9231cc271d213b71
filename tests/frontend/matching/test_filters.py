"""The outlier filters alone and in any order: who rejects what, and that every match remembers it."""

from itertools import permutations
from typing import get_args

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.config import Config, Filter, MatchingConfig, SslConfig
from asfm.config_file import load_config
from asfm.errors import AsfmError
from asfm.frontend.matching.filter_chain import filter_pairs
from asfm.frontend.matching.filters import FILTERS
from asfm.frontend.matching.frame_pair import FramePair
from asfm.frontend.matching.nearest import NearestNeighbours
from asfm.geometry.elevation_arcs import project_arcs
from asfm.geometry.poses import make_pose, transform
from asfm.geometry.sonar import SonarModel, back_project, project
from asfm.types import FloatArray, Keypoints, Matches

SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.7, 0.7), (600, 256), 0.3)
COUNT, WRONG = 60, 12
"""The first dozen matches are of points elsewhere."""
B_FROM_A = make_pose(np.array([0.2, -0.3, 0.05]), Rotation.from_rotvec([0.02, -0.01, 0.1]))


def keypoints_at(xyz_m: FloatArray, patches: FloatArray) -> Keypoints:
    range_m, bearing_rad, _ = project(xyz_m)
    count = len(xyz_m)
    nothing = np.zeros((count, 61), dtype=np.uint8)
    return Keypoints(np.zeros((count, 2)), range_m, bearing_rad, np.ones(count), nothing, patches.astype(np.float32))


def scatter(rng: np.random.Generator, count: int) -> FloatArray:
    return back_project(rng.uniform(2, 8, count), rng.uniform(-0.6, 0.6, count), rng.uniform(-0.1, 0.1, count))


def make_pair(seed: int = 0, count: int = COUNT, wrong: int = WRONG) -> FramePair:
    rng = np.random.default_rng(seed)
    points = scatter(rng, count)
    there = transform(B_FROM_A, points)
    there[:wrong] = scatter(rng, wrong)
    patches = rng.random((count, 15, 15))
    other = patches + 0.02 * rng.random(patches.shape)
    other[:wrong] = rng.random((wrong, 15, 15))
    ratio = np.where(np.arange(count) < wrong, 0.95, 0.6)
    nearest = NearestNeighbours(np.stack([np.arange(count)] * 2, axis=1), ratio, np.arange(count) >= wrong)
    a, b = keypoints_at(points, patches), keypoints_at(there, other)
    arcs = project_arcs(SONAR, B_FROM_A, np.stack([a.range_m, a.bearing_rad], axis=1))
    return FramePair(a, b, nearest, SONAR, arcs, np.tile([0.02, 0.01], (count, 1)))


def filter_matches(pair: FramePair, frame_a: int, frame_b: int, config: Config) -> Matches:
    return filter_pairs([pair], [(frame_a, frame_b)], config.matching.filters, config)[0]


def config_of(*names: Filter) -> Config:
    return Config(matching=MatchingConfig(filters=names))


@pytest.mark.parametrize("name", sorted(FILTERS))
def test_each_filter_alone_rejects_the_wrong_and_keeps_the_right(name: Filter) -> None:
    found = filter_matches(make_pair(), 3, 5, config_of(name))
    assert (found.frame_a, found.frame_b, found.filters) == (3, 5, (name,))
    assert set(found.index[:, 0].tolist()) >= set(range(WRONG, COUNT))
    assert found.count_rejected() == {name: COUNT - len(found)}
    assert COUNT - len(found) >= (6 if name == "clique" else 10)
    assert len(found.cost) == len(found)


@pytest.mark.parametrize("names", list(permutations(("ssl", "planar", "arc"))))
def test_in_every_order_the_first_to_object_is_remembered(names: tuple[Filter, ...]) -> None:
    pair = make_pair()
    found = filter_matches(pair, 0, 1, config_of(*names))
    assert found.filters == names
    assert set(found.index[:, 0].tolist()) == set(range(WRONG, COUNT))
    assert sorted([*found.index[:, 0].tolist(), *found.rejected[:, 0].tolist()]) == list(range(COUNT))
    ((first, _),) = FILTERS[names[0]]([pair], config_of())
    assert found.rejected[found.rejected_by == 0, 0].tolist() == np.flatnonzero(~first).tolist()
    assert sum(found.count_rejected().values()) == WRONG


def test_no_filter_keeps_everything_and_the_ratio_is_the_cost() -> None:
    pair = make_pair()
    found = filter_matches(pair, 0, 1, config_of())
    assert len(found) == COUNT and found.filters == () and found.count_rejected() == {}
    np.testing.assert_array_equal(found.cost, pair.nearest.ratio)


def test_terms_of_the_loss_can_be_switched_and_weighed() -> None:
    pair = make_pair()

    def cost(structural: float = 1.0, spatial: float = 1.0) -> FloatArray:
        loss = SslConfig(max_loss=1e9, structural_weight=structural, spatial_weight=spatial)
        config = Config(matching=MatchingConfig(filters=("ssl",)), ssl=loss)
        return filter_matches(pair, 0, 1, config).cost - pair.nearest.ratio

    structural, spatial = cost(spatial=0.0), cost(structural=0.0)
    assert structural.min() > 0 and spatial.min() > 0
    np.testing.assert_allclose(cost(2.0, 0.5), 2 * structural + 0.5 * spatial)
    assert not cost(0.0, 0.0).any()


def test_the_arc_says_nothing_without_a_prediction() -> None:
    whole = make_pair()
    pair = FramePair(whole.keypoints_a, whole.keypoints_b, whole.nearest, SONAR)
    assert len(filter_matches(pair, 0, 1, config_of("arc"))) == COUNT


def test_the_list_of_filters_is_an_argument_and_pairs_do_not_influence_each_other() -> None:
    pairs, frames = [make_pair(0), make_pair(1, count=20, wrong=3)], [(0, 1), (1, 2)]
    names: tuple[Filter, ...] = ("ratio", "ssl", "arc")
    together = filter_pairs(pairs, frames, names, config_of("mutual"))
    for pair, (a, b), found in zip(pairs, frames, together, strict=True):
        alone = filter_matches(pair, a, b, config_of(*names))
        assert (found.frame_a, found.frame_b, found.filters) == (a, b, names)
        np.testing.assert_array_equal(found.index, alone.index)
        np.testing.assert_allclose(found.cost, alone.cost, rtol=1e-6)
    assert filter_pairs([], [], names, config_of()) == []


def test_every_filter_that_can_be_asked_for_exists() -> None:
    assert set(FILTERS) == set(get_args(Filter))


@pytest.mark.parametrize("count", [0, 1])
def test_nothing_or_one_match_passes_through_every_filter(count: int) -> None:
    found = filter_matches(
        make_pair(count=count, wrong=0), 0, 1, Config(matching=MatchingConfig(filters=get_args(Filter)))
    )
    assert len(found) == count
    assert found.index.shape == (count, 2) and found.rejected.shape == (0, 2)
    assert np.isfinite(found.cost).all()


def test_a_filter_that_judges_again_keeps_its_number() -> None:
    found = filter_matches(make_pair(), 0, 1, config_of("ratio", "arc"))
    again = found.reject(np.arange(len(found)) < 5, "arc")
    assert again.filters == ("ratio", "arc")
    assert again.count_rejected() == {"ratio": WRONG, "arc": 5}
    assert len(again) == len(found) - 5 and len(found) == COUNT - WRONG


def test_matches_without_a_past_have_rejected_nobody() -> None:
    matches = Matches(0, 1, np.zeros((2, 2), dtype=np.int64), np.zeros(2))
    assert matches.count_rejected() == {} and matches.rejected.shape == (0, 2)


@pytest.mark.parametrize(
    ("text", "message"), [("[ratio, ratio]", "at most once"), ("[ratio, magic]", "matching.filters"), ("7", "filters")]
)
def test_filters_that_do_not_exist_or_come_twice_are_named(text: str, message: str) -> None:
    with pytest.raises(AsfmError, match=message) as error:
        load_config(None, (f"matching.filters={text}",))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", ["arc", "planar", "clique"])
def test_a_place_that_is_not_finite_is_an_outlier_and_spoils_no_other(name: Filter) -> None:
    pair = make_pair(wrong=0)
    pair.keypoints_b.range_m[7] = np.nan
    pair.keypoints_b.bearing_rad[9] = np.inf
    with np.errstate(invalid="ignore"):
        found = filter_matches(pair, 0, 1, config_of(name))
    assert sorted(found.rejected[:, 0].tolist()) == [7, 9]
