"""Manifest of a study: what its folder holds, by which versions on which machine, so that nothing else mixes in."""

import os
import platform
from pathlib import Path
from typing import Any

from asfm import __version__
from asfm.errors import AsfmError
from asfm.results.json_file import write_json
from asfm.safe_json import read_json
from asfm.study.cell import Cell
from asfm.study.fingerprint import hash_content, list_versions
from asfm.study.study_definition import StudyDefinition

MANIFEST, PARTIAL = "manifest.json", ".manifest.json.partial"
PACKAGES = ("numpy", "scipy", "gtsam", "opencv-python-headless", "scikit-image", "pyarrow", "matplotlib")


def make_manifest(study: StudyDefinition, cells: list[Cell]) -> dict[str, Any]:
    """Return the content of manifest.json: the study, its cells, versions and machine."""
    return {
        "study_id": hash_content([cell.id for cell in cells]),
        "study": study.model_dump(mode="json"),
        "versions": {"asfm": __version__, "python": platform.python_version(), **list_versions(PACKAGES)},
        "machine": {"system": platform.platform(), "processor": _name_processor(), "cores": os.cpu_count() or 1},
        "cells": [cell.id for cell in cells],
    }


def make_folder(folder: Path) -> None:
    """Make the folder of a study where there is none.

    Raises:
        AsfmError: it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise AsfmError(f"{folder}: cannot make the folder: {error.strerror}") from None


def open_study_folder(folder: Path, manifest: dict[str, Any]) -> None:
    """Check that a folder is empty or holds the same study, and write its manifest.

    Raises:
        AsfmError: the folder holds another study or other files, or cannot be read or written.
    """
    path = folder / MANIFEST
    try:
        entries = sorted({entry.name for entry in folder.iterdir()} - {PARTIAL})
    except OSError as error:
        raise AsfmError(f"{folder}: cannot look into the folder: {error.strerror}") from None
    if MANIFEST in entries:
        found = read_json(path, "the manifest of a study")
        if not isinstance(found, dict) or found.get("study_id") != manifest["study_id"]:
            raise AsfmError(
                f"{folder}: holds another study, or the same of other inputs, asfm or libraries: choose another folder"
            )
        return
    if entries:
        raise AsfmError(f"{folder}: expected an empty folder or that of the same study, found {entries[0]}")
    try:
        write_json(folder / PARTIAL, manifest)
        (folder / PARTIAL).replace(path)
    except OSError as error:
        raise AsfmError(f"{path}: cannot write: {error.strerror}") from None
    finally:
        (folder / PARTIAL).unlink(missing_ok=True)


def _name_processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()
