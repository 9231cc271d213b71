"""Cells: their names depend on all that their results depend on, those of what they share on no more than that."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from asfm.config import Config
from asfm.study.cell import Cell, Corruption, External, Recording, Simulation

TANK = Simulation("tank", "didson", None, 0, 5)
CELL = Cell(TANK, 0, "all", "akaze", "default", "default", Config(), 3)
CORRUPTION = Corruption(0.1, "random", 0.5, 0.5, "white", 1.0, None, 50)


def change(**sections: Any) -> Config:
    return Config.model_validate(sections)


@pytest.mark.parametrize(
    "changed",
    [
        replace(CELL, seed=1),
        replace(CELL, mode="sonar"),
        replace(CELL, bound_draws=0),
        replace(CELL, sequence=replace(TANK, scene_seed=1)),
        replace(CELL, sequence=replace(TANK, sonar_content="x")),
        replace(CELL, sequence=Recording("tank-didson", Path("a"), "content")),
        replace(CELL, config=change(backend={"rounds": 1})),
        replace(CELL, config=change(seed=1)),
        replace(CELL, corruption=CORRUPTION),
        replace(CELL, external=External("mine", "content")),
        replace(CELL, filters="other"),
    ],
)
def test_whatever_changes_a_result_changes_the_name_of_its_cell(changed: Cell) -> None:
    assert changed.id != CELL.id
    assert replace(CELL).id == CELL.id


def test_cells_share_features_whatever_follows_them() -> None:
    key = CELL.features_key
    assert replace(CELL, mode="sonar", config=change(backend={"rounds": 1}, seed=3)).features_key == key
    assert replace(CELL, config=change(matching={"filters": ["mutual"]})).features_key == key
    assert replace(CELL, config=change(matching={"max_gap": 2})).features_key != key
    assert replace(CELL, config=change(keypoints={"detector": "orb"})).features_key != key
    assert replace(CELL, config=change(frames={"every": 2})).features_key != key
    assert replace(CELL, seed=1).features_key != key, "another seed, other images"


def test_a_recording_is_the_same_for_every_seed_and_place() -> None:
    one, other = (Recording("a", Path(path), "content") for path in ("x", "y"))
    assert replace(CELL, sequence=one, seed=0).features_key == replace(CELL, sequence=other, seed=1).features_key
    assert replace(CELL, sequence=one).id == replace(CELL, sequence=other).id


def test_simulated_sequences_are_named_by_what_is_unusual() -> None:
    assert TANK.name == "tank-didson"
    assert replace(TANK, motion="hover", scene_seed=2, sonar="/a/my.json").name == "tank-my-hover-scene2"
    assert CELL.label == "tank-didson, akaze, default, default, all, seed 0"
