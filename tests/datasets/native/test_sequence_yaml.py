"""Schema of sequence.yaml."""

from pathlib import Path

import pytest

from asfm.datasets.native.reader import read_native
from asfm.datasets.native.writer import write_native
from asfm.errors import AsfmError
from tests.datasets.sequences import make_sequence


@pytest.mark.parametrize(
    ("bearings", "message"),
    [
        ("bearing_deg: [5, 5]", r"two different bearing_deg"),
        ("bearings_deg: [0, 1, 3, 2, 4, 5, 6, 7]", r"all increase or all decrease"),
        ("bearings_deg: [0, 1, 2]", r"expected 8 sonar\.bearings_deg.*found 3"),
        ("bearings_deg: [0, 1, 2, 3, 4, 5, 6, .inf]", r"bearings_deg\.7"),
        ("name: x", r"expected either bearing_deg"),
    ],
)
def test_bearings_that_make_no_sense_are_refused(tmp_path: Path, bearings: str, message: str) -> None:
    write_native(tmp_path / "sequence", make_sequence())
    text = f"sonar:\n  range_m: [0, 1]\n  elevation_aperture_deg: 12\n  {bearings}\n"
    (tmp_path / "sequence" / "sequence.yaml").write_text(text)
    with pytest.raises(AsfmError, match=message):
        read_native(tmp_path / "sequence")
