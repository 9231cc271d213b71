"""What the command line does, for Python to call as well: nothing here prints."""

from asfm.commands.convert import convert_sequence
from asfm.commands.demo import run_demo
from asfm.commands.denoise import denoise_sources
from asfm.commands.describe import describe_sequence
from asfm.commands.evaluate import evaluate_folder
from asfm.commands.run import run_sequence
from asfm.commands.simulate import simulate_to
from asfm.commands.view import view_folder
from asfm.results.report import RunSummary

__all__ = [
    "RunSummary",
    "convert_sequence",
    "denoise_sources",
    "describe_sequence",
    "evaluate_folder",
    "run_demo",
    "run_sequence",
    "simulate_to",
    "view_folder",
]
