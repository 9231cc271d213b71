"""Options of the command line: dataclass fields as parameters, and defaults equal to those of the Python functions."""

from dataclasses import MISSING, dataclass, fields
from inspect import signature
from pathlib import Path
from typing import Annotated

import pytest
import typer

from asfm.cli.app import app
from asfm.cli.options import DenoiseOptions, RunOptions, SimulateOptions, takes_options
from asfm.commands import DenoiseSources, SimulationOptions, run_sequence


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of a test command."""

    path: Annotated[Path, typer.Argument()]
    names: Annotated[list[str] | None, typer.Option("--name")] = None
    count: Annotated[int, typer.Option()] = 3


def test_command_receives_one_object_of_the_dataclass() -> None:
    received: list[Options] = []

    @takes_options(Options)
    def command(options: Options) -> None:
        """Describe the command."""
        received.append(options)

    test_app = typer.Typer()
    test_app.command()(command)
    group = typer.main.get_command(test_app)
    assert group.help == "Describe the command."
    group.main(["here", "--name", "a", "--name", "b"], standalone_mode=False)
    group.main(["there", "--count", "5"], standalone_mode=False)
    assert received == [Options(path=Path("here"), names=["a", "b"]), Options(path=Path("there"), count=5)]


def test_parameters_have_names_types_and_defaults_of_the_fields() -> None:
    @takes_options(Options)
    def command(options: Options) -> None:
        """Do nothing."""

    parameters = signature(command).parameters
    assert list(parameters) == ["path", "names", "count"]
    assert parameters["path"].default is parameters["path"].empty
    assert parameters["count"].default == 3


@pytest.mark.parametrize("options", [SimulateOptions, DenoiseOptions])
def test_defaults_equal_those_of_the_python_functions(options: type) -> None:
    """The command line cannot import them: that would load NumPy before ``asfm --help`` answers."""
    python = SimulationOptions() if options is SimulateOptions else DenoiseSources()
    defaults = {field.name: field.default for field in fields(options)}
    for field in fields(python):
        assert (defaults[field.name] or None) == (getattr(python, field.name) or None), field.name
    assert signature(run_sequence).parameters["recording"].default is RunOptions.rerun


@pytest.mark.parametrize(
    ("command", "names"),
    [
        ("run", "output config set mode rerun no-rerun features matches overwrite"),
        ("simulate", "output scene sonar frames seed motion format overwrite"),
        ("denoise", "frames scene sonar seed config set output overwrite"),
        ("evaluate", "reference"),
        ("convert", "overwrite"),
        ("demo", "frames output"),
    ],
)
def test_option_names_are_stable(command: str, names: str) -> None:
    group = typer.main.get_command(app)
    found = group.commands[command].params  # type: ignore[attr-defined]
    options = {name for item in found for name in (*item.opts, *item.secondary_opts) if name.startswith("--")}
    assert options == {f"--{name}" for name in names.split()}


def test_every_option_has_a_help_text() -> None:
    group = typer.main.get_command(app)
    for name, command in group.commands.items():  # type: ignore[attr-defined]
        assert command.help and all(item.help for item in command.params), name
    assert all(field.default is not MISSING for field in fields(DenoiseOptions)), "asfm denoise needs no argument"
