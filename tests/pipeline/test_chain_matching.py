"""Matching by several filter chains at once: the matches of each chain alone, for one pass over the images."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from asfm.config import Config, Filter
from asfm.frontend.matching.nearest import NearestNeighbours, find_nearest_neighbours
from asfm.frontend.matching.ssl import structural_spatial_loss
from asfm.navigation.frame_navigation import read_navigation
from asfm.navigation.pose_prediction import predict_poses
from asfm.pipeline.chain_matching import FilterChain, extract_chains
from asfm.pipeline.feature_matching import extract_matches
from asfm.recorder import NullRecorder
from asfm.sequence import Sequence
from asfm.simulation.simulate import simulate
from asfm.stages import StageClock
from asfm.types import FloatArray, Frame, ImageArray

CHAINS: tuple[tuple[Filter, ...], ...] = (
    (),
    ("mutual", "ratio"),
    ("ssl", "mutual"),
    ("mutual", "ratio", "arc"),
    ("mutual", "ratio", "arc", "planar", "ssl"),
)


@pytest.fixture(scope="module")
def sequence() -> Sequence:
    simulated = simulate("tank", "didson", 5, 1).sequence
    frames = list(simulated)
    return replace(simulated, read_frame=frames.__getitem__)


@pytest.mark.parametrize(("guided", "radius_px"), [(False, 14), (True, 14), (False, 0)])
def test_each_chain_has_the_matches_that_it_has_alone(sequence: Sequence, guided: bool, radius_px: int) -> None:
    config = Config.model_validate(
        {"matching": {"max_gap": 3, "guided": guided}, "localisation": {"radius_px": radius_px}}
    )
    prediction = predict_poses(read_navigation(sequence, config.backend), sequence)
    chains = [FilterChain(filters, poses) for filters in CHAINS for poses in (None, prediction)]
    reads: list[int] = []

    def read_frame(index: int) -> Frame:
        reads.append(index)
        return sequence.read_frame(index)

    keypoints, found = extract_chains(replace(sequence, read_frame=read_frame), config, chains)
    assert reads == list(range(5)), "one pass over the images"
    assert sum(len(match) for match in found[2]) > 50
    for chain, matches in zip(chains, found, strict=True):
        alone = config.model_copy(update={"matching": config.matching.model_copy(update={"filters": chain.filters})})
        own_keypoints, own = extract_matches(sequence, alone, NullRecorder(), StageClock(), chain.prediction)
        for one, other in zip(keypoints, own_keypoints, strict=True):
            assert np.array_equal(one.row_column, other.row_column) and not one.patches.size
        assert [(match.frame_a, match.frame_b, match.filters) for match in matches] == [
            (match.frame_a, match.frame_b, match.filters) for match in own
        ]
        for one_match, other_match in zip(matches, own, strict=True):
            for name in ("index", "cost", "rejected", "rejected_by", "sigma"):
                np.testing.assert_array_equal(getattr(one_match, name), getattr(other_match, name), err_msg=name)


def test_losses_and_neighbours_are_computed_once(sequence: Sequence, monkeypatch: pytest.MonkeyPatch) -> None:
    compared: list[int] = []
    searched: list[int] = []

    def compare(patches_a: ImageArray, *others: Any) -> FloatArray:
        compared.append(len(patches_a))
        return structural_spatial_loss(patches_a, *others)

    def search(*keypoints: Any) -> NearestNeighbours:
        searched.append(1)
        return find_nearest_neighbours(*keypoints)

    monkeypatch.setattr("asfm.frontend.matching.filters.structural_spatial_loss", compare)
    monkeypatch.setattr("asfm.frontend.matching.pair_matching.find_nearest_neighbours", search)
    config = Config.model_validate({"matching": {"max_gap": 3}})
    extract_chains(sequence, config, [FilterChain(("ssl",))])
    every_match = sum(compared)
    compared.clear()
    searched.clear()
    chains = [FilterChain(("mutual", "ssl")), FilterChain(("ssl", "mutual", "ratio")), FilterChain(("ratio", "ssl"))]
    extract_chains(sequence, config, chains)
    assert len(searched) == 3 + 3 + 2 + 1
    assert sum(compared) == every_match > 100, "each match is compared once, whatever the number of chains"
