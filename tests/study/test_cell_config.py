"""Configuration of a cell: what the cell's axes set goes over the study's changes, which go over the defaults."""

import pytest

from asfm.config import Config
from asfm.errors import AsfmError
from asfm.study.cell_config import MODE_SETTINGS, make_config


def test_own_settings_go_over_changes_and_those_over_defaults() -> None:
    changes = {"backend": {"rounds": 2}, "loops": {"enabled": False}}
    config = make_config("mine", changes, {"backend": MODE_SETTINGS["sonar"]}, 7)
    assert config.seed == 7 and config.backend.rounds == 2 and not config.loops.enabled
    assert not config.backend.use_odometry and config.matching == Config().matching


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"speed": 1}, "back-end 'mine': unknown key 'speed'; known here: backend, cfar"),
        ({"backend": {"speed": 1}}, "unknown key 'backend.speed'; known here: elevation_correlation"),
        ({"backend": {"rounds": 0}}, "key 'backend.rounds': Input should be greater than or equal to 1"),
    ],
)
def test_unknown_and_invalid_settings_are_one_line(changes: dict[str, object], message: str) -> None:
    with pytest.raises(AsfmError, match=message):
        make_config("mine", changes, {}, 0)
