"""Diagnostics: runs of frames, their text, and codes that are all listed and all in use."""

import ast
import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from asfm.diagnostics import CODES, MAX_RUNS, Diagnostic, format_runs, frame_runs, step_runs

ROOT = Path(__file__).resolve().parents[1]
WHICH = np.array([1, 1, 0, 1, 0, 1, 1, 1], dtype=bool)


def codes_in(path: Path) -> set[str]:
    """Return the codes of all diagnostics that a file makes; a code that is no literal fails."""
    calls = [
        node
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] == "Diagnostic"
    ]
    codes = set()
    for call in calls:
        code = call.args[0] if call.args else None
        assert isinstance(code, ast.Constant) and isinstance(code.value, str), f"{path}:{call.lineno}: no literal code"
        codes.add(code.value)
    return codes


def test_runs_of_frames_have_both_ends_included() -> None:
    assert frame_runs(WHICH) == ((0, 1), (3, 3), (5, 7))
    assert frame_runs(WHICH, 2) == ((0, 1), (5, 7))
    assert frame_runs(WHICH, 4) == ()


def test_runs_of_steps_join_the_frames_around_them() -> None:
    assert step_runs(WHICH) == ((0, 2), (3, 4), (5, 8))


@pytest.mark.parametrize("count", [0, 1, 5])
def test_none_or_all_selected(count: int) -> None:
    assert frame_runs(np.zeros(count, dtype=bool)) == step_runs(np.zeros(count, dtype=bool)) == ()
    assert frame_runs(np.ones(count, dtype=bool)) == (((0, count - 1),) if count else ())
    assert step_runs(np.ones(count, dtype=bool)) == (((0, count),) if count else ())


@given(st.lists(st.booleans(), max_size=30))
def test_runs_hold_exactly_the_selected_frames_and_never_touch(selected: list[bool]) -> None:
    runs = frame_runs(np.array(selected, dtype=bool))
    listed = [index for first, last in runs for index in range(first, last + 1)]
    assert listed == [index for index, value in enumerate(selected) if value]
    assert all(after[0] - before[1] > 1 for before, after in pairwise(runs))


def test_runs_are_formatted_and_many_are_counted() -> None:
    assert format_runs(()) == ""
    assert format_runs(((0, 0), (3, 5), (9, 9))) == "0, 3-5, 9"
    runs = tuple((4 * index, 4 * index + 1) for index in range(MAX_RUNS + 5))
    assert format_runs(runs[:MAX_RUNS]).count(", ") == MAX_RUNS - 1
    assert format_runs(runs) == f"{format_runs(runs[:MAX_RUNS])}, and 5 more runs"


def test_an_unknown_code_is_refused() -> None:
    with pytest.raises(ValueError, match="found 'no-such-code'"):
        Diagnostic("no-such-code", "something")


def test_a_diagnostic_reads_as_its_message_with_the_code_and_goes_through_json() -> None:
    found = Diagnostic("odometry-gap", "no reading near 2 frames", ((3, 4),))
    assert str(found) == "no reading near 2 frames [odometry-gap]"
    assert json.loads(json.dumps(found.as_dict())) == {
        "code": "odometry-gap",
        "message": "no reading near 2 frames",
        "frames": [[3, 4]],
        "severity": "warning",
    }


def test_the_codes_in_use_are_those_listed() -> None:
    files = [path for folder in ("asfm", "frontend", "backend") for path in (ROOT / folder).rglob("*.py")]
    assert set().union(*(codes_in(path) for path in files)) == set(CODES)


def test_codes_are_lower_case_words_with_a_meaning() -> None:
    for code, meaning in CODES.items():
        assert code.replace("-", "").isalpha() and code == code.lower()
        assert meaning and not meaning.endswith(".")
