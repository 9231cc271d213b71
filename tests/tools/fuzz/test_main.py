"""The command line of the fuzzer: a table, and an exit code that tells of failures."""

import sys
from pathlib import Path

import pytest

from tools.fuzz import __main__ as fuzzer
from tools.fuzz.cases import Target


def make(folder: Path) -> None:
    folder.mkdir()
    (folder / "x").write_bytes(b"valid")


def test_the_table_counts_cases_and_lists_failures(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    targets = {
        "good": Target("x", make, lambda folder: None),
        "bad": Target("x", make, lambda folder: {b"valid": 1}[(folder / "x").read_bytes()]),
    }
    monkeypatch.setattr(fuzzer, "TARGETS", targets)
    monkeypatch.setattr(sys, "argv", ["fuzz", "--cases", "4", "--target", "good"])
    assert fuzzer.main() == 0 and capsys.readouterr().out.split()[-5:] == ["good", "4", "0", "4", "0"]
    monkeypatch.setattr(sys, "argv", ["fuzz", "--cases", "4"])
    assert fuzzer.main() == 1 and "  case 0: KeyError" in capsys.readouterr().out
