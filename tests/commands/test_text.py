"""Text of results: aligned columns."""

from asfm.commands.text import align, describe_errors
from asfm.evaluation.evaluation_table import EvaluationTable


def test_numbers_are_aligned_to_the_right_and_text_to_the_left() -> None:
    assert align([("name", "s"), ("a", "10.5")], numbers=(1,)) == ["name     s", "a     10.5"]
    assert align([("a", "b"), ("long", "")]) == ["a     b", "long"]


def test_notes_follow_the_table() -> None:
    header, note = describe_errors(EvaluationTable((), ("short path",)))
    assert header.split() == ["measure", "run", "unit", "odometry", "ratio"]
    assert note == "note: short path"
