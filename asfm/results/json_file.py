"""JSON files with sorted keys and finite numbers."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from asfm.results.output_file import write_file


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write a dictionary as indented JSON with sorted keys; NumPy values and paths become plain JSON values.

    Raises:
        AsfmError: the file cannot be written.
        ValueError: a value is not finite or not representable in JSON, named by its key: a defect of the caller.
    """
    text = json.dumps(_to_plain(content, path.stem), allow_nan=False, sort_keys=True, indent=2, ensure_ascii=False)
    write_file(path, (text + "\n").encode(errors="backslashreplace"))  # file names that are not UTF-8: \\udcff


def _to_plain(value: Any, key: str) -> Any:
    """Convert NumPy values and paths to JSON types; ``key`` is the dotted path of the value, for messages."""
    if isinstance(value, dict):
        return {str(name): _to_plain(item, f"{key}.{name}") for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_to_plain(item, f"{key}[{index}]") for index, item in enumerate(value)]
    if isinstance(value, np.ndarray | np.generic):
        return _to_plain(value.tolist(), key)
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, float) and not np.isfinite(value):
        raise ValueError(f"{key}: expected a finite number, or None for a missing one, found {value}")
    if value is None or isinstance(value, str | int | float):
        return value
    raise ValueError(f"{key}: expected a JSON value, found a {type(value).__name__}")
