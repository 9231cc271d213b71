"""Printing: results on stdout, diagnostics and errors on stderr."""

import os
import subprocess
import sys

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


STREAMS = """
import os, sys
from asfm.cli.terminal import *
prepare_streams()
assert os.open(os.devnull, os.O_RDONLY) > 2
print_progress("begin")
print_lines(["lines", chr(0xDCFF)] * 5000)
flush_output()
print_error("end")
"""


@pytest.mark.skipif(os.name != "posix", reason="a shell closes the streams")
@pytest.mark.parametrize("streams", [">&-", "2>&-", "<&-", "<&- >&- 2>&-", "| true", "2>&1 | true", "| head -n 1"])
def test_closed_streams_and_readers_that_go_are_no_error(streams: str) -> None:
    command = f'set -o pipefail; "$0" -c "$1" {streams}'
    done = subprocess.run(["bash", "-c", command, sys.executable, STREAMS], capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert done.stderr.splitlines() == ([] if "2>" in streams else ["begin", "asfm: end"])


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no device that is always full")  # noqa: PTH110
def test_output_on_a_full_disk_is_a_fault_and_progress_is_not() -> None:
    with open("/dev/full", "w") as full:  # noqa: PTH123 - a device
        command = [sys.executable, "-c", STREAMS]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
        assert done.returncode == 1 and "AsfmError: standard output: cannot write: No space left" in done.stderr
        done = subprocess.run(command, stderr=full, stdout=subprocess.PIPE, text=True, check=False)
        assert done.returncode == 0 and len(done.stdout.splitlines()) == 10_000
