"""Printing to the terminal: results on stdout, diagnostics and errors on stderr."""

import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import IO, TYPE_CHECKING

from asfm.errors import AsfmError

if TYPE_CHECKING:
    from asfm.diagnostics import Diagnostic


def prepare_streams() -> None:
    """Replace standard streams that are closed, and let all of them escape letters that they cannot show.

    A file that is opened while a standard stream is closed would get its number, and receive what libraries print.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            while os.open(os.devnull, os.O_RDWR) < number:
                pass  # a lower number is free too
    sys.stdout = sys.stdout or _open_nothing()
    sys.stderr = sys.stderr or _open_nothing()
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


def silence_libraries() -> None:
    """Let only Python write to stderr, and discard what libraries in other languages print there."""
    try:
        own = os.dup(2)
    except OSError:
        return
    sys.stderr = os.fdopen(own, "w", buffering=1, encoding="utf-8", errors="backslashreplace")
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 2)
    os.close(nothing)


def print_lines(lines: Iterable[str]) -> None:
    """Print lines of results on stdout.

    Raises:
        AsfmError: they cannot be written, for example on a full disk. A reader that has gone is no error.
    """
    import typer

    with _output_may_end():
        for line in lines:
            typer.echo(line)


def flush_output() -> None:
    """Write what stdout still holds.

    Raises:
        AsfmError: it cannot be written, for example on a full disk. A reader that has gone is no error.
    """
    with _output_may_end():
        sys.stdout.flush()


@contextmanager
def _output_may_end() -> Iterator[None]:
    """Discard the rest of the output when stdout takes no more."""
    try:
        yield
    except OSError as error:
        sys.stdout = _open_nothing(sys.stdout)
        if not isinstance(error, BrokenPipeError):
            raise AsfmError(f"standard output: cannot write: {error.strerror}") from None


def print_diagnostics(diagnostics: "Iterable[Diagnostic]") -> None:
    """Print each diagnostic on stderr as "severity: message [code]"."""
    for item in diagnostics:
        _print_remark(f"{item.severity}: {item}", None if item.severity == "info" else "yellow")


def print_progress(message: str) -> None:
    """Print that a stage begins, on stderr."""
    _print_remark(message)


def print_error(message: str) -> None:
    """Print an error on stderr as one line."""
    _print_remark(f"asfm: {' '.join(message.splitlines())}")


def format_count(number: int, noun: str) -> str:
    """Format a count with its noun in singular or plural."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _print_remark(message: str, colour: str | None = None) -> None:
    """Print on stderr. Where that is impossible nobody can be told, and the work goes on."""
    import typer  # not at the top: signals are handled before it is loaded

    try:
        typer.secho(message, err=True, fg=colour)
    except OSError:
        sys.stderr = _open_nothing(sys.stderr)


def _open_nothing(instead_of: IO[str] | None = None) -> IO[str]:
    """Return a stream that discards all; also what a stream still holds, which Python would write when it ends."""
    if instead_of is not None:
        try:
            number = instead_of.fileno()
        except (OSError, ValueError):
            pass
        else:
            nothing = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nothing, number)
            os.close(nothing)
            return instead_of
    return open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123 - stays open
