"""Ticks of HoloOcean recordings: selection, order and validation of pickles."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from asfm.datasets import open_sequence
from asfm.errors import AsfmError
from tests.datasets.holoocean_files import make_state, write_folder


def test_ticks_without_the_sonar_are_left_out(tmp_path: Path) -> None:
    states = [make_state(0), {"t": 10.5}, make_state(2)]
    sequence = open_sequence(write_folder(tmp_path / "a", states))
    (diagnostic,) = sequence.diagnostics
    assert len(sequence) == 2 and diagnostic.code == "incomplete-records"
    assert "1 of 3 pickles" in diagnostic.message


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ImagingSonar": np.zeros((3, 3, 3))}, r"expected ImagingSonar as \(ranges, beams\).*\(3, 3, 3\)"),
        ({"ImagingSonar": np.zeros((8, 6))}, r"expected \(16, 6\) \(RangeBins, AzimuthBins\).*found \(8, 6\)"),
        ({"ImagingSonar": "picture"}, r"expected ImagingSonar as"),
        ({"PoseSensor": np.zeros((4, 4))}, r"expected a rotation in the pose"),
        ({"PoseSensor": np.diag([1.0, 1, -1, 1])}, r"expected a rotation in the pose"),
        ({"PoseSensor": np.full((4, 4), np.nan)}, r"expected a finite 4 x 4 pose"),
        ({"PoseSensor": np.eye(3)}, r"expected a finite 4 x 4 pose"),
        ({"t": "noon"}, r"expected one finite number of seconds as t, found 'noon'"),
        ({"t": float("nan")}, r"expected one finite number of seconds as t"),
    ],
)
def test_an_invalid_pickle_is_reported_in_one_line(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    root = write_folder(tmp_path / "a", [make_state(0, **changes)])
    with pytest.raises(AsfmError, match=rf"0\.pkl: {message}") as error:
        open_sequence(root)
    assert "\n" not in str(error.value)
