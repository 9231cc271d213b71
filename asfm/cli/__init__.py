"""The command line ``asfm``: parses arguments, calls asfm.commands, prints the results. The only package that prints.

NumPy and everything heavier is imported when a command runs, so that ``asfm --help`` answers at once.
"""

from asfm.cli.entry_point import main, run_command_line

__all__ = ["main", "run_command_line"]
