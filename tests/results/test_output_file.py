"""Result files: lines, exact time stamps, finite numbers, and one-line errors."""

from pathlib import Path

import numpy as np
import pytest

from asfm.errors import AsfmError
from asfm.results.output_file import format_stamps, require_finite, write_file, write_lines


def test_every_line_ends_with_a_newline(tmp_path: Path) -> None:
    write_lines(tmp_path / "table.csv", ["a,b", "1,2"])
    assert (tmp_path / "table.csv").read_bytes() == b"a,b\n1,2\n"


def test_a_file_that_cannot_be_written_is_a_one_line_error(tmp_path: Path) -> None:
    with pytest.raises(AsfmError, match=r"^[^\n]*below/table\.csv: cannot write: [^\n]*$"):
        write_file(tmp_path / "below" / "table.csv", b"")


def test_stamps_read_back_exactly_without_exponents() -> None:
    stamps_s = np.array([0.0, 0.1, 1 / 3, 1.7e9 + 1 / 3, 1e-9])
    text = format_stamps(stamps_s)
    assert [float(stamp) for stamp in text] == stamps_s.tolist()
    assert not any("e" in stamp for stamp in text)


def test_the_row_of_a_value_that_is_not_finite_is_named() -> None:
    require_finite("poses", np.zeros((3, 2)), np.zeros(0))
    broken = np.zeros((3, 2))
    broken[1, 1] = np.nan
    with pytest.raises(ValueError, match=r"^poses: row 1 is not finite$"):
        require_finite("poses", np.zeros(3), broken)
