"""The commands of the command line as Python functions; nothing here prints.

Each is imported when it is first used, so that a command loads nothing of the others.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from asfm.commands.compare import compare_folders
    from asfm.commands.convert import convert_sequence
    from asfm.commands.demo import run_demo
    from asfm.commands.denoise import DenoiseSources, denoise_sources
    from asfm.commands.describe import describe_sequence
    from asfm.commands.evaluate import evaluate_folder
    from asfm.commands.run import run_sequence
    from asfm.commands.simulate import SimulationOptions, simulate_to
    from asfm.commands.study import plan_study, run_study
    from asfm.commands.view import view_folder
    from asfm.results.run_summary import RunSummary

__all__ = [
    "DenoiseSources",
    "RunSummary",
    "SimulationOptions",
    "compare_folders",
    "convert_sequence",
    "denoise_sources",
    "describe_sequence",
    "evaluate_folder",
    "plan_study",
    "run_demo",
    "run_sequence",
    "run_study",
    "simulate_to",
    "view_folder",
]

_MODULES = {
    "DenoiseSources": "asfm.commands.denoise",
    "RunSummary": "asfm.results.run_summary",
    "SimulationOptions": "asfm.commands.simulate",
    "compare_folders": "asfm.commands.compare",
    "convert_sequence": "asfm.commands.convert",
    "denoise_sources": "asfm.commands.denoise",
    "describe_sequence": "asfm.commands.describe",
    "evaluate_folder": "asfm.commands.evaluate",
    "plan_study": "asfm.commands.study",
    "run_demo": "asfm.commands.demo",
    "run_sequence": "asfm.commands.run",
    "run_study": "asfm.commands.study",
    "simulate_to": "asfm.commands.simulate",
    "view_folder": "asfm.commands.view",
}
"""Module of each public name."""


if not TYPE_CHECKING:  # a type checker would accept every name that __getattr__ might return

    def __getattr__(name: str) -> object:
        """Import a public name at its first use (PEP 562)."""
        if name not in _MODULES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = globals()[name] = getattr(import_module(_MODULES[name]), name)
        return value
