"""Layout of the tests: a test file of its name in the mirrored place for every module of the package."""

from pathlib import Path

import pytest

from tests.test_architecture import ROOT, package_files

MAX_WITHOUT = 15
WITHOUT_A_TEST_FILE = {
    "asfm/__main__.py": "calls asfm.cli.main",
    "asfm/cli/app.py": "the commands, each tested in tests/commands",
    "asfm/commands/denoise_files.py": "files of asfm denoise: tests/commands/test_denoise.py",
    "asfm/pipeline/reconstruction.py": "the whole pipeline: tests/end_to_end",
    "asfm/pipeline/summary.py": "calls of the back-end: tests/end_to_end/test_pipeline.py",
    "asfm/results/run_summary.py": "a dataclass without methods",
    "asfm/simulation/scenes/hull.py": "a scene: tests/simulation/scenes/test_catalogue.py",
    "asfm/simulation/scenes/pier.py": "a scene: tests/simulation/scenes/test_catalogue.py",
    "asfm/simulation/scenes/seafloor.py": "a scene: tests/simulation/scenes/test_catalogue.py",
    "asfm/simulation/scenes/tank.py": "a scene: tests/simulation/scenes/test_catalogue.py",
    "asfm/simulation/scenes/wreck.py": "a scene: tests/simulation/scenes/test_catalogue.py",
    "asfm/study/report/page_style.py": "a style sheet without code",
    "asfm/visualization/blueprint.py": "read back from recordings: tests/visualization/test_rerun_recorder.py",
    "asfm/visualization/world.py": "read back from recordings: tests/visualization/test_rerun_recorder.py",
    "backend/graph/problem.py": "a dataclass without methods",
}
"""Modules without a test file of their own, each with the reason."""


def mirrored_test(path: Path) -> Path:
    """Return the place of a module's test file: asfm/geometry/fan.py -> tests/geometry/test_fan.py."""
    place = path.relative_to(ROOT / "asfm" if path.is_relative_to(ROOT / "asfm") else ROOT)
    return ROOT / "tests" / place.parent / f"test_{place.name}"


def test_every_module_has_a_test_file_in_the_mirrored_place() -> None:
    modules = [path for path in package_files() if path.name != "__init__.py"]
    missing = {str(path.relative_to(ROOT)) for path in modules if not mirrored_test(path).is_file()}
    assert sorted(missing - set(WITHOUT_A_TEST_FILE)) == []
    assert all((ROOT / name).is_file() for name in WITHOUT_A_TEST_FILE)
    assert len(WITHOUT_A_TEST_FILE) <= MAX_WITHOUT


@pytest.mark.parametrize("reason", sorted(set(WITHOUT_A_TEST_FILE.values())))
def test_files_that_a_reason_names_exist(reason: str) -> None:
    places = [word for word in reason.split() if word.startswith("tests/")]
    assert all((ROOT / place).exists() for place in places)
