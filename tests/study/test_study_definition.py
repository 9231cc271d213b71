"""Study files: defaults, numbers of seeds, and one line for everything that is wrong."""

from pathlib import Path
from typing import get_args

import pytest

from asfm.errors import AsfmError
from asfm.learned.catalogue import LEARNED_MATCHERS
from asfm.study.study_definition import LearnedMatcher, read_study

BAD_NAMES = ("'$x$'", "'=1+1'", '"a\\nb"', '"\\x07"', "'<b>'", "'a|b'", "''")
"""A formula of LaTeX and one of a spreadsheet, control characters, and what tables and pages give a meaning to."""
SCENES = "simulate: {scenes: [tank]}\n"


def write(folder: Path, text: str) -> Path:
    path = folder / "study.yaml"
    path.write_text(text)
    return path


def test_a_number_of_seeds_counts_from_zero(tmp_path: Path) -> None:
    study = read_study(write(tmp_path, SCENES + "detectors: [akaze, orb]\nseeds: 3\n"))
    assert study.seeds == (0, 1, 2) and study.modes == ("all",) and study.detectors == ("akaze", "orb")
    assert study.simulate and study.simulate.frames == 80
    assert list(study.filters) == ["default"] and study.backend == {"default": {}}
    assert read_study(write(tmp_path, SCENES + "detectors: [akaze]\nseeds: [7, 3]\n")).seeds == (7, 3)


def test_learned_matchers_are_those_of_the_catalogue(tmp_path: Path) -> None:
    assert get_args(LearnedMatcher) == tuple(LEARNED_MATCHERS)
    assert read_study(write(tmp_path, SCENES + "learned: [xfeat]\n")).learned == ("xfeat",)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (SCENES + "detectors: [akaze]\ncolour: red\n", "unknown key 'colour' in the study; known here: backend, bound"),
        (SCENES + "corruption: {wrong: [0.1]}\n", "unknown key 'corruption.wrong' .* bearing_noise_beams, design"),
        ("simulate: {scenes: [tank], sonar: [x]}\ndetectors: [akaze]\n", "unknown key 'simulate.sonar'.*sonars"),
        (SCENES + "detectors: [surf]\n", "'akaze', 'orb', 'sift' or 'brisk', found 'surf'"),
        (SCENES + "detectors: [akaze]\nfilters: {a: [best]}\n", "'mutual', 'ratio', 'ssl'.* found 'best'"),
        (SCENES + "detectors: [akaze]\nmodes: [blind]\n", "'sonar', 'odometry' or 'all', found 'blind'"),
        (SCENES, "expected detectors, learned or external matchers, or corruption, found none: the grid is empty"),
        (SCENES + "learned: [superglue]\n", "'aliked_lightglue', 'disk_lightglue' or 'xfeat', found 'superglue'"),
        (SCENES + "learned: [xfeat, xfeat]\n", "expected each value of learned once, found 'xfeat' again"),
        ("detectors: [akaze]\n", "expected sequences, or scenes to simulate, found neither: the grid is empty"),
        ("sequences: [a]\ncorruption: {}\n", "corruption needs true points"),
        (SCENES + "detectors: [akaze]\nseeds: []\n", "key 'seeds'.* expected one seed or more"),
        (SCENES + "detectors: [akaze]\nseeds: 0\n", "key 'seeds'.* expected their number, 1 to 20000, .*found 0"),
        (SCENES + "detectors: [akaze]\nseeds: 100000\n", "expected their number, 1 to 20000, .*found 100000"),
        *((SCENES + f"detectors: [akaze]\nfilters: {{{name}: []}}\n", "filters.*pattern") for name in BAD_NAMES),
        (SCENES + "detectors: [akaze, akaze]\n", "expected each value of detectors once, found 'akaze' again"),
        (SCENES + "corruption: {recall: [1, 0]}\n", "'corruption.recall.1'.*greater than 0, found 0"),
        (SCENES + "external: [{name: a}]\n", "expected either features and matches, or function"),
        (SCENES + "external: [{name: a, function: nothing}]\n", "external.0.function.*pattern"),
        (SCENES + "external: [{name: akaze, function: 'a:b'}]\n", "other than those of asfm, found akaze"),
        (SCENES + "external: [{name: xfeat, function: 'a:b'}]\n", "other than those of asfm, found xfeat"),
        ("[1, 2]\n", "expected the keys of a study"),
    ],
)
def test_what_is_wrong_is_one_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(AsfmError, match=message) as caught:
        read_study(write(tmp_path, text))
    assert str(caught.value).startswith(str(tmp_path)) and "\n" not in str(caught.value)
