"""Kernels against their peers, on a small image."""

import pytest

from tools.benchmark.__main__ import main, report
from tools.benchmark.kernels import COMPARISONS, Comparison, choose_comparisons


def test_kernels_agree_with_their_peers(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["all", "--shape", "120", "60", "--rounds", "1"]) == 0
    assert capsys.readouterr().out.count("asfm  ") == len(COMPARISONS)


def test_other_results_are_reported() -> None:
    original = COMPARISONS["clusters"]((60, 40), 0)
    wrong = Comparison("wrong", original.ours, {"peer": lambda: ~original.ours()}, original.tolerance)
    assert report(original, 1) and not report(wrong, 1)


def test_kernels_are_chosen_by_name_or_prefix() -> None:
    assert choose_comparisons("cfar") == ["cfar", "cfar-goca", "cfar-soca", "cfar-os"]
    assert choose_comparisons("cfar-os") == ["cfar-os"]
    assert choose_comparisons("all") == list(COMPARISONS)
