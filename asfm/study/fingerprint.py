"""Fingerprints of contents: the stable names of cells and of what they share."""

import hashlib
import importlib.util
import json
import os
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

import asfm
from asfm.errors import AsfmError, quote
from asfm.results.report_json import find_version

HEX_LETTERS = 20
CHUNK_BYTES = 1 << 20
LIBRARIES = ("numpy", "scipy", "gtsam", "opencv-python-headless", "scikit-image", "scikit-learn")
"""Packages whose versions can change a result."""
SHOWING = ("cli", "visualization", "study/report")
"""Folders of asfm that change no result."""


def hash_content(content: Any) -> str:
    """Return the fingerprint of plain values (mappings, lists, strings, numbers), whatever the order of their keys."""
    text = json.dumps(content, sort_keys=True, allow_nan=False, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:HEX_LETTERS]


def hash_path(path: Path) -> str:
    """Return the fingerprint of a file, or of all files of a folder with their names.

    Raises:
        AsfmError: a file cannot be read.
    """
    digest = hashlib.sha256()
    try:
        for file in [path] if path.is_file() else sorted(path.rglob("*")):
            if file.is_file():
                digest.update(os.fsencode(file.relative_to(path)) + b"\0" + str(file.stat().st_size).encode() + b"\0")
                with file.open("rb") as stream:
                    while chunk := stream.read(CHUNK_BYTES):
                        digest.update(chunk)
    except OSError as error:
        raise AsfmError(f"{error.filename or path}: cannot read: {error.strerror}") from None
    return digest.hexdigest()[:HEX_LETTERS]


def hash_function(entry_point: str) -> str:
    """Return the fingerprint of the source of ``module:function``, which is not run for that.

    Of a module in a package all Python files of the outermost package count. What else the function reads, such as
    weights or other modules, is not looked at.

    Raises:
        AsfmError: there is no such module.
    """
    module = entry_point.partition(":")[0]
    try:
        found = importlib.util.find_spec(module)
        outer = importlib.util.find_spec(module.partition(".")[0])
    except Exception as error:  # whatever a package does at its import
        raise AsfmError(f"external matcher {quote(entry_point)}: cannot find the module: {error}") from None
    if found is None or outer is None:
        raise AsfmError(f"external matcher {quote(entry_point)}: expected a module on Python's path, found none")
    folders = [Path(folder) for folder in outer.submodule_search_locations or ()]
    if folders:
        return hash_content([entry_point, *map(hash_sources, folders)])
    origin = Path(found.origin) if found.origin and Path(found.origin).is_file() else None
    return hash_content([entry_point, hash_path(origin) if origin else ""])


def hash_sources(folder: Path, left_out: tuple[str, ...] = ()) -> str:
    """Return the fingerprint of all Python files below a folder, links followed, with their names.

    Args:
        folder: of a package.
        left_out: folders in it, as "study/report", whose files do not count.

    Raises:
        AsfmError: a file cannot be read.
    """
    found: dict[str, str] = {}
    for root, folders, files in os.walk(folder, followlinks=True):
        inside = Path(root).relative_to(folder)
        folders[:] = sorted(name for name in folders if (inside / name).as_posix() not in left_out)
        found |= {(inside / name).as_posix(): hash_path(Path(root) / name) for name in files if name.endswith(".py")}
    return hash_content(found)


@cache
def hash_software() -> str:
    """Return the fingerprint of all that computes a cell: asfm's source, and the versions of the libraries it uses.

    What shows results, and does not change them, is left out.
    """
    return hash_content([hash_sources(Path(asfm.__file__).parent, SHOWING), list_versions(LIBRARIES)])


def list_versions(packages: Iterable[str]) -> dict[str, str]:
    """Return the versions of those packages that are installed."""
    found = {package: find_version(package) for package in packages}
    return {package: version for package, version in found.items() if version is not None}
