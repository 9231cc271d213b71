"""Printing: results on stdout, diagnostics and errors on stderr."""

import pytest

from asfm.cli.terminal import format_count, print_diagnostics, print_error, print_lines
from asfm.diagnostics import Diagnostic


def test_diagnostics_are_printed_with_severity_and_code(capsys: pytest.CaptureFixture[str]) -> None:
    found = Diagnostic("mirror-ambiguity", "two mirror images")
    estimated = Diagnostic("estimated-range-bias", "a bias of 0.02 m", severity="info")
    print_diagnostics([found, estimated])
    out, err = capsys.readouterr()
    assert out == ""
    assert err == "warning: two mirror images [mirror-ambiguity]\ninfo: a bias of 0.02 m [estimated-range-bias]\n"


def test_error_is_one_line_on_stderr(capsys: pytest.CaptureFixture[str]) -> None:
    print_error("first\nsecond")
    assert capsys.readouterr() == ("", "asfm: first second\n")


def test_results_are_printed_on_stdout(capsys: pytest.CaptureFixture[str]) -> None:
    print_lines(["a", "b"])
    assert capsys.readouterr() == ("a\nb\n", "")


@pytest.mark.parametrize(("number", "text"), [(0, "0 frames"), (1, "1 frame"), (2, "2 frames")])
def test_count_has_its_noun_in_singular_or_plural(number: int, text: str) -> None:
    assert format_count(number, "frame") == text
