"""The public names of the package: they resolve, load lazily, and have types for code outside."""

import subprocess
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import pytest

import asfm

ROOT = Path(__file__).resolve().parents[1]
PUBLIC = {
    "Config": "asfm.config",
    "Keypoints": "asfm.types",
    "Matches": "asfm.types",
    "Reconstruction": "asfm.types",
    "Sequence": "asfm.sequence",
    "SonarModel": "asfm.geometry.sonar",
    "Tracks": "asfm.types",
    "open_sequence": "asfm.datasets",
    "reconstruct": "asfm.pipeline",
    "simulate": "asfm.simulation.simulate",
}
OUTSIDE = """
from pathlib import Path

import asfm

sequence = asfm.open_sequence(Path("recording"))
run = asfm.reconstruct(sequence, asfm.Config())
reveal_type(run.reconstruction.tracks.range_m)
reveal_type(asfm.simulate("tank").sequence)
keypoints: list[asfm.Keypoints] = []
matches: list[asfm.Matches] = []
parts: tuple[asfm.Tracks, asfm.Reconstruction, asfm.SonarModel, asfm.Sequence] | None = None
asfm.reconstruct("recording", asfm.Config())
asfm.recontruct
"""
"""A program that uses every public name; its last two lines are errors that mypy must find."""


def test_public_names_are_those_of_the_package() -> None:
    assert set(asfm.__all__) == set(PUBLIC)
    assert set(PUBLIC) <= set(dir(asfm)) and "__version__" in dir(asfm)


@pytest.mark.parametrize("name", PUBLIC)
def test_public_name_is_that_of_its_module(name: str) -> None:
    assert getattr(asfm, name) is getattr(import_module(PUBLIC[name]), name)


@pytest.mark.parametrize(("name", "loaded"), [("Config", False), ("open_sequence", False), ("reconstruct", True)])
def test_public_name_resolves_in_a_fresh_interpreter_and_loads_gtsam_only_if_needed(name: str, loaded: bool) -> None:
    code = f"import sys, asfm; assert 'numpy' not in sys.modules; asfm.{name}; print('gtsam' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert run.stdout.strip() == str(loaded)


def test_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'asfm' has no attribute 'reconstrct'"):
        asfm.reconstrct  # type: ignore[attr-defined]  # noqa: B018


def test_types_are_known_to_code_outside(tmp_path: Path) -> None:
    """The checks of the project have the same options, so that this run finds most of its cache."""
    path = tmp_path / "outside.py"
    path.write_text(OUTSIDE)
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file", "pyproject.toml", str(path)]
    run = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    found = [line.partition("outside.py:")[2] for line in run.stdout.splitlines() if "outside.py:" in line]
    first = OUTSIDE.splitlines().index("reveal_type(run.reconstruction.tracks.range_m)") + 1
    last = len(OUTSIDE.splitlines())
    assert len(found) == 4, run.stdout + run.stderr
    assert found[0].startswith(f"{first}: note: Revealed type is") and "ndarray" in found[0] and "float64" in found[0]
    assert found[1].startswith(f"{first + 1}: note: Revealed type is") and "asfm.sequence.Sequence" in found[1]
    assert found[2].startswith(f"{last - 1}: error: Argument 1 to") and "[arg-type]" in found[2]
    assert found[3].startswith(f"{last}: error: Module has no attribute") and "[attr-defined]" in found[3]


def test_type_marker_is_packaged() -> None:
    setuptools = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
    assert "py.typed" in setuptools["package-data"]["asfm"] and (ROOT / "asfm" / "py.typed").is_file()
