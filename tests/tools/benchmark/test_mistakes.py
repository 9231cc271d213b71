"""Plausible mistakes: each changes the recording, and no two are the same."""

import pytest

from tools.benchmark.mistakes import MISTAKES, Mistake


def test_there_are_many_and_each_has_its_name() -> None:
    names = [mistake.name for mistake in MISTAKES]
    assert len(names) >= 35 and len(set(names)) == len(names)


def test_every_sensor_is_wrong_somewhere() -> None:
    for sensor in ("images", "odometry", "navigation"):
        assert sum(sensor in mistake.wrong for mistake in MISTAKES) >= 5


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda mistake: mistake.name)
def test_a_mistake_about_geometry_is_one_of_the_images(mistake: Mistake) -> None:
    assert mistake.wrong == "images" or not mistake.about_geometry
