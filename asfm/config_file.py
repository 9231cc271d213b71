"""Configuration files: defaults, overridden by a YAML file, overridden by single settings."""

from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ValidationError

from asfm.config import Config
from asfm.errors import AsfmError

YAML_ERRORS = (yaml.YAMLError, ValueError, RecursionError)
"""Exceptions of PyYAML on malformed text; ValueError for impossible dates, numbers and bytes."""


def load_config(path: Path | None = None, overrides: tuple[str, ...] = ()) -> Config:
    """Return the defaults, overridden by a YAML file and then by single settings.

    Args:
        path: YAML file with sections of keys; the defaults where it is None.
        overrides: settings of the form ``section.key=value``.

    Raises:
        AsfmError: the file cannot be read, a key is unknown or a value is invalid.
    """
    settings = _read_yaml(path) if path is not None else {}
    for override in overrides:
        _apply_override(settings, override)
    try:
        return Config.model_validate(settings)
    except ValidationError as error:
        raise AsfmError(_describe_fault(error, path)) from None


def dump_config(config: Config) -> str:
    """Format a configuration as YAML that :func:`load_config` reads back."""
    return yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False)


def _read_yaml(path: Path) -> dict[str, Any]:
    try:
        settings = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, *YAML_ERRORS) as error:
        raise AsfmError(f"{path}: cannot read the configuration: {' '.join(str(error).split())}") from None
    if settings is None:
        return {}
    if not isinstance(settings, dict):
        raise AsfmError(f"{path}: expected sections with keys, found {type(settings).__name__}")
    return {key: value for key, value in settings.items() if value is not None}  # a section without keys


def _apply_override(settings: dict[str, Any], override: str) -> None:
    name, separator, text = override.partition("=")
    if not separator or not name.strip():
        raise AsfmError(f"--set {override}: expected section.key=value")
    *sections, key = name.strip().split(".")
    for section in sections:
        settings = settings.setdefault(section, {})
        if not isinstance(settings, dict):
            raise AsfmError(f"--set {override}: {section} is a value, not a section")
    try:
        settings[key] = yaml.safe_load(text)
    except YAML_ERRORS:
        raise AsfmError(f"--set {_shorten(override)}: {_shorten(text)!r} is not a YAML value") from None


def _describe_fault(error: ValidationError, path: Path | None) -> str:
    first = error.errors()[0]
    name = ".".join(str(part) for part in first["loc"])
    where = f"{path}: " if path is not None else ""
    if first["type"] == "extra_forbidden":
        known = ", ".join(_known_keys(first["loc"]))
        return f"{where}unknown key {name!r} in the configuration; known here: {known}"
    if first["type"] == "value_error":
        return f"{where}configuration section {name!r}: {first['msg'].removeprefix('Value error, ')}"
    return f"{where}configuration key {name!r}: {first['msg']}, found {_shorten(repr(first['input']))}"


def _shorten(text: str) -> str:
    return text if len(text) <= 80 else f"{text[:77]}..."


def _known_keys(location: tuple[int | str, ...]) -> list[str]:
    model: type[BaseModel] = Config
    for part in location[:-1]:
        annotation = model.model_fields[str(part)].annotation
        if not (isinstance(annotation, type) and issubclass(annotation, BaseModel)):
            return []
        model = annotation
    return sorted(model.model_fields)
