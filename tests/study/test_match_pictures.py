"""Pictures of matches: which cells get one, which frames it shows, and lines that end at the keypoints."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from asfm.config import Config
from asfm.evaluation.matching import evaluate_by_truth
from asfm.geometry.fan import FanGrid
from asfm.simulation.simulate import SimulatedSequence
from asfm.study.cell import Cell, Corruption, Simulation
from asfm.study.match_pictures import FAN_PX, MAX_LINES, PICTURES, SPACE_PX, choose_illustrated, write_match_picture
from asfm.study.sequence_provider import StudySequence
from asfm.types import Matches
from tests.study.test_cell_metrics import CELL, make_run, observe, open_sequence
from tests.study.test_cell_metrics import tank as tank  # a fixture


def draw(tank: SimulatedSequence, folder: Path, opened: StudySequence, matches: list[Matches]) -> dict[str, Any]:
    truth = tank.sequence.groundtruth
    assert truth is not None
    run = make_run(truth.world_from_vehicle, tank.sequence, observe(tank)[0], matches)
    write_match_picture(folder, CELL, opened, run)
    content = json.loads((folder / PICTURES / f"{CELL.id}.json").read_text())
    assert isinstance(content, dict)
    return content


def test_correct_and_wrong_matches_are_those_of_the_evaluation(tank: SimulatedSequence, tmp_path: Path) -> None:
    keypoints, matches = observe(tank)
    turned = matches[2].index.copy()
    turned[:20, 1] = np.roll(turned[:20, 1], 1)
    picture = draw(tank, tmp_path, open_sequence(tank), [replace(matches[2], index=turned)])
    truth = tank.sequence.groundtruth
    assert truth is not None
    poses = truth.world_from_vehicle @ tank.sequence.vehicle_from_sonar
    quality = evaluate_by_truth(keypoints, [replace(matches[2], index=turned)], poses, tank.read_truth)[1]
    assert picture["frames"] == [2, 3] and picture["matches"] == 40 and picture["correct"] == quality.correct
    assert len(picture["correct_lines"]) == min(quality.correct, MAX_LINES)
    assert len(picture["wrong_lines"]) == min(40 - quality.correct, MAX_LINES)
    assert picture["judged_by"] == "their true elevations"
    grid = FanGrid.fit(tank.sequence.sonar, *FAN_PX)
    begin = grid.pixel_at(keypoints[2].range_m[turned[:, 0]], keypoints[2].bearing_rad[turned[:, 0]])
    end = grid.pixel_at(keypoints[3].range_m[turned[:, 1]], keypoints[3].bearing_rad[turned[:, 1]])
    expected = np.round(np.hstack([begin, end + np.array([grid.width_px + SPACE_PX, 0])]), 1)
    drawn = np.array(picture["correct_lines"] + picture["wrong_lines"])
    distance = np.abs(drawn[:, None] - expected[None]).max(axis=-1)
    assert (distance.min(axis=1) < 0.06).all()
    image = cv2.imread(str(tmp_path / PICTURES / picture["image"]), cv2.IMREAD_GRAYSCALE)
    assert image is not None and image.shape == (picture["height_px"], picture["width_px"])
    assert image[-1, 0] > 240 and image.min() < 128, "dark echoes on white"


def test_the_pair_is_the_one_nearest_to_four_frames_in_the_middle(tank: SimulatedSequence, tmp_path: Path) -> None:
    index = np.zeros((1, 2), dtype=np.int64)
    pairs = [Matches(a, b, index, np.zeros(1)) for a, b in ((0, 1), (0, 3), (1, 4), (0, 2), (1, 3))]
    assert draw(tank, tmp_path, open_sequence(tank), pairs)["frames"] == [1, 4]
    assert draw(tank, tmp_path, open_sequence(tank), [*pairs, Matches(0, 4, index, np.zeros(1))])["frames"] == [0, 4]
    assert draw(tank, tmp_path, open_sequence(tank), pairs[3:])["frames"] == [1, 3]


def test_without_truth_matches_are_judged_by_arcs_or_not_at_all(tank: SimulatedSequence, tmp_path: Path) -> None:
    matches = observe(tank)[1][2:3]
    opened = open_sequence(tank, with_truth=False)
    by_arcs = draw(tank, tmp_path, opened, matches)
    assert "elevation arcs" in by_arcs["judged_by"] and 0 <= by_arcs["correct"] <= 40
    bare = replace(opened, sequence=replace(opened.sequence, groundtruth=None))
    unjudged = draw(tank, tmp_path, bare, matches)
    assert unjudged["correct"] is None and unjudged["wrong_lines"] == []
    assert len(unjudged["correct_lines"]) == MAX_LINES


def test_nothing_is_drawn_without_matched_frames(tank: SimulatedSequence, tmp_path: Path) -> None:
    truth = tank.sequence.groundtruth
    assert truth is not None
    run = make_run(truth.world_from_vehicle, tank.sequence, observe(tank)[0], [])
    write_match_picture(tmp_path, CELL, open_sequence(tank), run)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("first_seed", [0, 7])
def test_the_first_cell_of_each_sequence_matcher_and_chain_is_illustrated(first_seed: int) -> None:
    corruption = Corruption(0.1, "random", 0.5, 0.25, "white", 0.9, 7, 50)
    cells = [
        Cell(Simulation("tank", sonar, None, 0, 5), seed, mode, matcher, chain, "default", Config(), 3)
        for seed in (first_seed, first_seed + 1)
        for sonar in ("didson", "aris")
        for mode in ("sonar", "all")
        for matcher in ("akaze", "orb")
        for chain in ("ratio", "all")
    ]
    chosen = [cell for cell in cells if cell.id in choose_illustrated(cells)]
    assert len(chosen) == 8 and {(cell.seed, cell.mode) for cell in chosen} == {(first_seed, "sonar")}
    assert choose_illustrated([replace(cells[0], corruption=corruption)]) == frozenset()
