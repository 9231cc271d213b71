"""Printing to the terminal: results on stdout, diagnostics and errors on stderr."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from asfm.diagnostics import Diagnostic


def print_lines(lines: Iterable[str]) -> None:
    """Print lines of results on stdout."""
    for line in lines:
        typer.echo(line)


def print_diagnostics(diagnostics: "Iterable[Diagnostic]") -> None:
    """Print each diagnostic on stderr as "severity: message [code]"."""
    for item in diagnostics:
        typer.secho(f"{item.severity}: {item}", err=True, fg=None if item.severity == "info" else "yellow")


def print_error(message: str) -> None:
    """Print an error on stderr as one line."""
    typer.echo(f"asfm: {' '.join(message.splitlines())}", err=True)


def format_count(number: int, noun: str) -> str:
    """Format a count with its noun in singular or plural."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
