"""Entry point of the command line: exit codes and one-line error messages."""

import sys
import traceback
from collections.abc import Sequence
from typing import NoReturn

from asfm import __version__
from asfm.cli.memory import MemoryReserve, is_out_of_memory
from asfm.cli.signals import Stopped
from asfm.cli.supervisor import supervise
from asfm.cli.terminal import flush_output, prepare_streams, print_error
from asfm.errors import AsfmError

EXIT_DONE, EXIT_DEFECT, EXIT_BAD_INPUT, EXIT_INTERRUPTED = 0, 1, 2, 130


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run a command line, by default that of this process under supervision, and exit with its exit code."""
    prepare_streams()
    if arguments is not None:
        sys.exit(run_command_line(arguments))
    sys.exit(supervise(lambda: run_command_line(sys.argv[1:])))


def run_command_line(arguments: Sequence[str]) -> int:
    """Run one command line.

    Returns:
        The exit code: 0 done, 1 a defect of asfm, 2 bad input, command line or machine (memory, disk), 128 + number
        of the signal that stopped it (130 interrupted). A reader of stdout that goes early (``| head``) is no error.
    """
    reserve = MemoryReserve()
    try:
        import typer

        from asfm.cli.app import app
    except (Exception, KeyboardInterrupt) as error:
        return _report(error, reserve)
    command = typer.main.get_command(app)
    try:
        with command.make_context("asfm", list(arguments) or ["--help"]) as context:
            command.invoke(context)
        flush_output()
    except typer.Exit as request:
        return request.exit_code
    except BaseException as error:
        if isinstance(error, GeneratorExit | SystemExit):
            raise
        return _report(error, reserve)
    return EXIT_DONE


def _report(error: BaseException, reserve: MemoryReserve) -> int:
    """Print an exception as one line, after a traceback where it is a defect, and return the exit code."""
    reserve.release()
    code, message = _explain(error)
    if code == EXIT_DEFECT:
        traceback.print_exc()
    print_error(message)
    return code


def _explain(error: BaseException) -> tuple[int, str]:
    """Return exit code and message for an exception."""
    if isinstance(error, KeyboardInterrupt):
        code = error.exit_code if isinstance(error, Stopped) else EXIT_INTERRUPTED
        return code, "interrupted; nothing half-written was left"
    if is_out_of_memory(error):
        return EXIT_BAD_INPUT, "not enough memory: expected more than this machine, or a limit (ulimit -v), gives"
    if isinstance(error, AsfmError):
        return EXIT_BAD_INPUT, str(error)
    if isinstance(error, OSError):
        text = f"{error.filename}: {error.strerror}" if error.filename else str(error)
        return EXIT_BAD_INPUT, str(AsfmError(text))  # on one line of bounded length
    if hasattr(error, "format_message"):  # usage errors of Typer and Click, which have no common base class
        context = getattr(error, "ctx", None)
        command = context.command_path if context is not None else "asfm"
        return EXIT_BAD_INPUT, f"{error.format_message().rstrip('.')}; see {command} --help"
    return EXIT_DEFECT, f"this is a defect of asfm {__version__}: please report it with the lines above"
