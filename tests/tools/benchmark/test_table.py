"""Table of requirements."""

from tools.benchmark.table import Requirement, tabulate


def test_a_requirement_is_met_within_its_limits() -> None:
    assert Requirement("a", 1.5, at_most=1.5).ok and not Requirement("a", 1.6, at_most=1.5).ok
    assert Requirement("a", 0.97, at_least=0.97).ok and not Requirement("a", 0.96, at_least=0.97).ok
    assert Requirement("a", None, at_most=1.0).ok is False, (
        "a number that was not measured does not meet its requirement"
    )
    assert Requirement("a", 3.0).ok is None
    lines = tabulate([Requirement("a", 1.5, "ms", at_most=1.5), Requirement("b", None, at_least=2)])
    assert [line.split() for line in lines[1:]] == [["a", "≤", "1.5", "1.5", "ms", "yes"], ["b", "≥", "2", "-", "NO"]]
    both = Requirement("NEES", 1.5, at_least=0.5, at_most=1.2)
    assert both.ok is False and both.cells()[1] == "0.5 to 1.2"
