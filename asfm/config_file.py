"""Configuration files: defaults, overridden by a YAML file, overridden by single settings."""

from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ValidationError

from asfm.config import Config
from asfm.errors import AsfmError, quote, shorten
from asfm.safe_yaml import parse_yaml, read_yaml


def load_config(path: Path | None = None, overrides: tuple[str, ...] = ()) -> Config:
    """Return the defaults, overridden by a YAML file and then by single settings.

    Args:
        path: YAML file with sections of keys; the defaults where it is None.
        overrides: settings of the form ``section.key=value``.

    Raises:
        AsfmError: the file cannot be read, a key is unknown or a value is invalid.
    """
    settings = _read_settings(path) if path is not None else {}
    for override in overrides:
        _apply_override(settings, override)
    try:
        return Config.model_validate(settings)
    except ValidationError as error:
        raise AsfmError(_describe_fault(error, path)) from None


def dump_config(config: Config) -> str:
    """Format a configuration as YAML that :func:`load_config` reads back."""
    return yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False)


def _read_settings(path: Path) -> dict[str, Any]:
    settings = read_yaml(path, "the configuration")
    if settings is None:
        return {}
    if not isinstance(settings, dict):
        raise AsfmError(f"{path}: expected sections with keys, found {type(settings).__name__}")
    return {key: value for key, value in settings.items() if value is not None}  # a section without keys


def _apply_override(settings: dict[str, Any], override: str) -> None:
    name, separator, text = override.partition("=")
    if not separator or not name.strip():
        raise AsfmError(f"--set {shorten(override)}: expected section.key=value")
    *sections, key = name.strip().split(".")
    for section in sections:
        settings = settings.setdefault(section, {})
        if not isinstance(settings, dict):
            raise AsfmError(f"--set {shorten(override)}: {shorten(section)} is a value, not a section")
    settings[key] = parse_yaml(text, f"--set {shorten(override)}: {quote(text)} is not a YAML value")


def _describe_fault(error: ValidationError, path: Path | None) -> str:
    first = error.errors(include_url=False, include_context=False)[0]
    name = quote(".".join(str(part) for part in first["loc"]))
    where = f"{path}: " if path is not None else ""
    if first["type"] == "extra_forbidden":
        known = ", ".join(_known_keys(first["loc"]))
        return f"{where}unknown key {name} in the configuration; known here: {known}"
    if first["type"] == "value_error":
        return f"{where}configuration section {name}: {shorten(first['msg'].removeprefix('Value error, '), 200)}"
    return f"{where}configuration key {name}: {shorten(first['msg'], 200)}, found {quote(first['input'])}"


def _known_keys(location: tuple[int | str, ...]) -> list[str]:
    model: type[BaseModel] = Config
    for part in location[:-1]:
        annotation = model.model_fields[str(part)].annotation
        if not (isinstance(annotation, type) and issubclass(annotation, BaseModel)):
            return []
        model = annotation
    return sorted(model.model_fields)
