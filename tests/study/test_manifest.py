"""Manifest: the same study may go on in its folder, nothing else may."""

from pathlib import Path

import pytest

from asfm.errors import AsfmError
from asfm.study.grid import build_grid
from asfm.study.manifest import MANIFEST, make_folder, make_manifest, open_study_folder
from asfm.study.study_definition import StudyDefinition


def manifest(folder: Path, seeds: int = 1) -> dict[str, object]:
    keys = {"simulate": {"scenes": ["tank"]}, "detectors": ["akaze"], "seeds": seeds}
    study = StudyDefinition.model_validate(keys)
    return make_manifest(study, build_grid(study, folder))


def test_the_same_study_goes_on_in_its_folder(tmp_path: Path) -> None:
    folder = tmp_path / "a" / "b"
    made = manifest(tmp_path)
    make_folder(folder)
    make_folder(folder)
    open_study_folder(folder, made)
    before = (folder / MANIFEST).read_bytes()
    open_study_folder(folder, manifest(tmp_path))
    assert (folder / MANIFEST).read_bytes() == before
    assert made["versions"]["asfm"] and made["machine"]["cores"] >= 1  # type: ignore[index]


def test_other_studies_and_files_are_refused(tmp_path: Path) -> None:
    make_folder(tmp_path / "one")
    open_study_folder(tmp_path / "one", manifest(tmp_path))
    with pytest.raises(AsfmError, match="holds another study"):
        open_study_folder(tmp_path / "one", manifest(tmp_path, seeds=2))
    (tmp_path / "two").mkdir()
    (tmp_path / "two" / "thesis.tex").touch()
    with pytest.raises(AsfmError, match=r"expected an empty folder or that of the same study, found thesis\.tex"):
        open_study_folder(tmp_path / "two", manifest(tmp_path))
    (tmp_path / "file").touch()
    with pytest.raises(AsfmError, match="cannot make the folder"):
        make_folder(tmp_path / "file")
    with pytest.raises(AsfmError, match="cannot look into the folder"):
        open_study_folder(tmp_path / "file", manifest(tmp_path))
    (tmp_path / "one" / MANIFEST).write_text("{}")
    with pytest.raises(AsfmError, match="holds another study"):
        open_study_folder(tmp_path / "one", manifest(tmp_path))
