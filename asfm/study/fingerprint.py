"""Fingerprints of contents: the stable names of cells and of what they share."""

import hashlib
import importlib.util
import json
import os
from pathlib import Path
from typing import Any

from asfm.errors import AsfmError, quote

HEX_LETTERS = 20
CHUNK_BYTES = 1 << 20


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
    """Return the fingerprint of the source file of ``module:function``, which is not run for that.

    Packages around the module are imported by Python.

    Raises:
        AsfmError: there is no such module.
    """
    module = entry_point.partition(":")[0]
    try:
        found = importlib.util.find_spec(module)
    except Exception as error:  # whatever a package does at its import
        raise AsfmError(f"external matcher {quote(entry_point)}: cannot find the module: {error}") from None
    if found is None:
        raise AsfmError(f"external matcher {quote(entry_point)}: expected a module on Python's path, found none")
    origin = Path(found.origin) if found.origin and Path(found.origin).is_file() else None
    return hash_content([entry_point, hash_path(origin) if origin else ""])
