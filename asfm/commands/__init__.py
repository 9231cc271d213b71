"""The commands of the command line as Python functions; nothing here prints."""

from asfm.commands.convert import convert_sequence
from asfm.commands.demo import run_demo
from asfm.commands.denoise import DenoiseSources, denoise_sources
from asfm.commands.describe import describe_sequence
from asfm.commands.evaluate import evaluate_folder
from asfm.commands.run import run_sequence
from asfm.commands.simulate import SimulationOptions, simulate_to
from asfm.commands.view import view_folder
from asfm.results.run_summary import RunSummary

__all__ = [
    "DenoiseSources",
    "RunSummary",
    "SimulationOptions",
    "convert_sequence",
    "denoise_sources",
    "describe_sequence",
    "evaluate_folder",
    "run_demo",
    "run_sequence",
    "simulate_to",
    "view_folder",
]
