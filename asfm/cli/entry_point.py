"""Entry point of the command line: exit codes and one-line error messages."""

import os
import sys
import traceback
from collections.abc import Sequence
from typing import NoReturn

import typer

from asfm import __version__
from asfm.cli.app import app
from asfm.cli.terminal import print_error
from asfm.errors import AsfmError

EXIT_DONE, EXIT_DEFECT, EXIT_BAD_INPUT, EXIT_INTERRUPTED, EXIT_CLOSED_PIPE = 0, 1, 2, 130, 141


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run a command line, by default that of this process, and exit with its exit code."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")  # terminals that cannot show a letter
    sys.exit(run_command_line(sys.argv[1:] if arguments is None else arguments))


def run_command_line(arguments: Sequence[str]) -> int:
    """Run one command line.

    Returns:
        The exit code: 0 done, 1 a defect of asfm, 2 bad input or command line, 130 interrupted, 141 closed pipe.
    """
    command = typer.main.get_command(app)
    try:
        with command.make_context("asfm", list(arguments) or ["--help"]) as context:
            command.invoke(context)
        sys.stdout.flush()
    except typer.Exit as request:
        return request.exit_code
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # else Python complains when it flushes at exit
        return EXIT_CLOSED_PIPE
    except (Exception, KeyboardInterrupt) as error:
        code, message = _explain(error)
        if code == EXIT_DEFECT:
            traceback.print_exc()
        print_error(message)
        return code
    return EXIT_DONE


def _explain(error: BaseException) -> tuple[int, str]:
    """Return exit code and message for an exception."""
    if isinstance(error, KeyboardInterrupt):
        return EXIT_INTERRUPTED, "interrupted; nothing half-written was left"
    if isinstance(error, AsfmError):
        return EXIT_BAD_INPUT, str(error)
    if isinstance(error, OSError):
        return EXIT_BAD_INPUT, f"{error.filename}: {error.strerror}" if error.filename else str(error)
    if hasattr(error, "format_message"):  # usage errors of Typer and Click, which have no common base class
        context = getattr(error, "ctx", None)
        command = context.command_path if context is not None else "asfm"
        return EXIT_BAD_INPUT, f"{error.format_message().rstrip('.')}; see {command} --help"
    return EXIT_DEFECT, f"this is a defect of asfm {__version__}: please report it with the lines above"
