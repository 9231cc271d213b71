"""Acoustic structure from motion for forward-looking imaging sonar.

The public names below are imported when they are first used, so that ``import asfm`` loads nothing heavy.
"""

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from asfm.config import Config
    from asfm.datasets import open_sequence
    from asfm.geometry.sonar import SonarModel
    from asfm.pipeline import reconstruct
    from asfm.sequence import Sequence
    from asfm.simulation.simulate import simulate
    from asfm.types import Keypoints, Matches, Reconstruction, Tracks

__version__ = version("asfm")

__all__ = [
    "Config",
    "Keypoints",
    "Matches",
    "Reconstruction",
    "Sequence",
    "SonarModel",
    "Tracks",
    "open_sequence",
    "reconstruct",
    "simulate",
]

_MODULES = {
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
"""Module of each public name."""


if not TYPE_CHECKING:  # a type checker would accept every name that __getattr__ might return

    def __getattr__(name: str) -> object:
        """Import a public name at its first use (PEP 562)."""
        if name not in _MODULES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = globals()[name] = getattr(import_module(_MODULES[name]), name)
        return value

    def __dir__() -> list[str]:
        """List the public names beside those already imported."""
        return sorted({*globals(), *__all__})
