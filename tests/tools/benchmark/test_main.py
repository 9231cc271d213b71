"""Command line of the benchmark."""

from pathlib import Path

import pytest

from tools.benchmark.__main__ import make_parser


def test_commands_are_parsed() -> None:
    parse = make_parser().parse_args
    run = parse(["run", "sequence", "--set", "seed=1", "--set", "backend.rounds=1"])
    assert (run.sequence, run.settings, run.recording) == (Path("sequence"), ["seed=1", "backend.rounds=1"], False)
    assert parse(["run", "sequence"]).settings == []
    assert parse(["public", "data", "--recording"]).recording
    assert parse(["all", "--shape", "30", "20"]).shape == [30, 20]
    assert parse(["rates"]).data is None
    for wrong in ([], ["run"], ["public"], ["sift"]):
        with pytest.raises(SystemExit):
            parse(wrong)
