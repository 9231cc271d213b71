"""Configuration of a cell: the defaults, the study's changes, and what the cell's matcher and sensor mode set."""

from typing import Any

from pydantic import ValidationError

from asfm.config import Config
from asfm.errors import AsfmError, quote, shorten
from asfm.study.cell import Corruption
from asfm.study.study_definition import Mode

MODE_SETTINGS: dict[Mode, dict[str, bool]] = {
    "sonar": {"use_odometry": False, "use_navigation": False},
    "odometry": {"use_odometry": True, "use_navigation": False},
    "all": {"use_odometry": True, "use_navigation": True},
}
"""Settings of the section ``backend`` in each sensor mode."""
AXES = {
    "seed": "seeds",
    "keypoints.detector": "detectors",
    "matching.filters": "filters",
    "backend.use_odometry": "modes",
    "backend.use_navigation": "modes",
}
"""Settings that an axis of the study sets."""
Sections = dict[str, dict[str, Any]]


def corruption_sections(corruption: Corruption) -> Sections:
    """Return the settings for true matches: no filter, no alignment of patches, and the stated noise as the sigma.

    White noise is independent along a track, which the default of the back-end does not assume.
    """
    return {
        "backend": {"track_correlation": 0.0} if corruption.noise_kind == "white" else {},
        "matching": {"filters": ()},
        "localisation": {"radius_px": 0},
        "noise": {
            "range_bins": max(corruption.range_noise_bins, 0.05),
            "bearing_beams": max(corruption.bearing_noise_beams, 0.05),
            "min_bearing_deg": 0.0,
            "estimated": False,
        },
    }


def make_config(name: str, changes: dict[str, Any], own: Sections, seed: int) -> Config:
    """Return the configuration of a cell: the defaults, then the study's changes, then what the cell's axes set.

    Args:
        name: of the changes, for messages.
        changes: by section, as in a file for ``--config``.
        own: sections that the cell's axes set.
        seed: of the cell.

    Raises:
        AsfmError: a setting is unknown or invalid, is set by an axis of the study, or would not be used.
    """
    _check_changes(name, changes)
    merged: dict[str, Any] = {key: dict(value) if isinstance(value, dict) else value for key, value in changes.items()}
    for section, values in own.items():
        if isinstance(merged.get(section, {}), dict):
            merged[section] = {**merged.get(section, {}), **values}
    try:
        return Config.model_validate({**merged, "seed": seed})
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        key = quote(".".join(str(part) for part in first["loc"]))
        if first["type"] == "extra_forbidden":
            known = ", ".join(sorted(Config.model_fields if len(first["loc"]) == 1 else _fields_of(first["loc"][0])))
            raise AsfmError(f"back-end {quote(name)}: unknown key {key}; known here: {known}") from None
        raise AsfmError(f"back-end {quote(name)}: key {key}: {shorten(first['msg'], 200)}") from None


def _check_changes(name: str, changes: dict[str, Any]) -> None:
    """Refuse what the axes of the study would override, and a noise that would be replaced by the estimated one."""
    sections = {key: value if isinstance(value, dict) else {} for key, value in changes.items()}
    keys = {*changes, *(f"{section}.{key}" for section, values in sections.items() for key in values)}
    for key, axis in AXES.items():
        if key in keys:
            raise AsfmError(f"back-end {quote(name)}: {quote(key)} is set by {quote(axis)} of the study: leave it out")
    noise = sections.get("noise", {})
    if set(noise) - {"estimated"} and noise.get("estimated") is not False:
        raise AsfmError(
            f"back-end {quote(name)}: the noise is estimated from the images: expected noise.estimated: false beside "
            f"{quote('noise.' + sorted(set(noise) - {'estimated'})[0])}"
        )


def _fields_of(section: int | str) -> list[str]:
    return list(type(getattr(Config(), str(section))).model_fields)
