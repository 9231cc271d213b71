"""The command line: parses arguments, calls a command, prints what it gives. The only file that prints.

Nothing heavy is imported before a command runs, so that ``asfm --help`` answers at once.
"""

import os
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from asfm import __version__
from asfm.errors import AsfmError

if TYPE_CHECKING:
    from asfm.diagnostics import Diagnostic

DONE, DEFECT, AT_FAULT, INTERRUPTED, CLOSED_PIPE = 0, 1, 2, 130, 141

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Acoustic structure from motion for forward-looking imaging sonar.",
)

SequencePath = Annotated[Path, typer.Argument(help="Folder or file of any format that is read.", metavar="SEQUENCE")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace what asfm wrote there before.")]


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line of this process, or the one given, and leave with its exit code."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")  # a terminal that lacks a letter is no reason to fail
    sys.exit(run_command_line(sys.argv[1:] if arguments is None else arguments))


def run_command_line(arguments: Sequence[str]) -> int:
    """Run one command line and give its exit code: 0 done, 2 input or command line at fault, 1 a defect of asfm."""
    command = typer.main.get_command(app)
    try:
        with command.make_context("asfm", list(arguments) or ["--help"]) as context:
            command.invoke(context)
        sys.stdout.flush()
    except typer.Exit as done:
        return done.exit_code
    except KeyboardInterrupt:
        return _complain("interrupted; nothing half-written was left", INTERRUPTED)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or Python complains when it flushes
        return CLOSED_PIPE
    except AsfmError as error:
        return _complain(str(error), AT_FAULT)
    except OSError as error:
        return _complain(f"{error.filename}: {error.strerror}" if error.filename else str(error), AT_FAULT)
    except Exception as error:
        if hasattr(error, "format_message"):  # Typer's and Click's own, whichever of the two defines it
            return _complain(_explain_usage(error), AT_FAULT)
        traceback.print_exc()
        return _complain(f"this is a defect of asfm {__version__}: please report it with the lines above", DEFECT)
    return DONE


@app.callback()
def asfm(
    version: Annotated[
        bool,
        typer.Option("--version", help="Show the version.", callback=lambda value: _show_version(value), is_eager=True),
    ] = False,
) -> None:
    """Acoustic structure from motion for forward-looking imaging sonar."""


@app.command()
def run(
    sequence: SequencePath,
    output: Annotated[Path, typer.Option(help="Folder for the results.")],
    config: Annotated[Path | None, typer.Option(help="YAML file of settings that differ from the defaults.")] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", help="One setting; may be repeated.", metavar="SECTION.KEY=VALUE")
    ] = None,
    mode: Annotated[str | None, typer.Option(help="How to go through the frames: batch.")] = None,
    rerun: Annotated[bool, typer.Option("--rerun/--no-rerun", help="Make a recording for the viewer.")] = True,
    features: Annotated[Path | None, typer.Option(help="Keypoints found elsewhere, an HDF5 file of hloc.")] = None,
    matches: Annotated[Path | None, typer.Option(help="Matches found elsewhere; goes with --features.")] = None,
    overwrite: Overwrite = False,
) -> None:
    """Reconstruct the trajectory and a 3-D point map of a sequence."""
    from asfm.commands import run_sequence
    from asfm.commands.text import describe_results
    from asfm.config_file import load_config

    overrides = tuple(settings or ()) + (() if mode is None else (f"mode={mode}",))
    resolved = load_config(config, overrides)
    if (features is None) != (matches is None):
        raise AsfmError("--features and --matches: expected both or neither, found one")
    given = None if features is None or matches is None else (features, matches)
    with _show_progress() as progress:
        summary = run_sequence(sequence, output, resolved, rerun, overwrite, progress, given)
    _say(describe_results(summary))
    _warn(summary.diagnostics)


@app.command()
def info(sequence: SequencePath) -> None:
    """Tell what a sequence holds."""
    from asfm.commands import describe_sequence
    from asfm.commands.text import align

    _say(align(describe_sequence(sequence)))


@app.command()
def evaluate(
    results: Annotated[Path, typer.Argument(help="Folder that asfm run wrote.", metavar="DIR")],
    reference: Annotated[Path | None, typer.Option(help="TUM file of true poses instead of the sequence's.")] = None,
) -> None:
    """Compare a run, and its odometry, with the true poses."""
    from asfm.commands import evaluate_folder
    from asfm.commands.text import describe_errors

    _say(describe_errors(evaluate_folder(results, reference)))


@app.command()
def view(results: Annotated[Path, typer.Argument(help="Folder that asfm run wrote.", metavar="DIR")]) -> None:
    """Look through a run in the Rerun viewer."""
    from asfm.commands import view_folder

    view_folder(results)


@app.command()
def simulate(
    output: Annotated[Path, typer.Option(help="Folder for the sequence.")],
    scene: Annotated[
        str | None,
        typer.Argument(metavar="SCENE", help="seafloor, pier, hull ..., a wrong name lists them all; or a mesh file."),
    ] = None,
    scene_option: Annotated[
        str | None, typer.Option("--scene", help="The same, as an option.", metavar="SCENE")
    ] = None,
    sonar: Annotated[str, typer.Option(help="A wrong name lists them all.")] = "oculus_m750d_high",
    frames: Annotated[int, typer.Option(help="How many.")] = 80,
    seed: Annotated[int, typer.Option(help="The same seed gives the same bytes.")] = 0,
    motion: Annotated[str | None, typer.Option(help="A wrong name lists them all.", metavar="NAME|FILE.tum")] = None,
    format_name: Annotated[
        str, typer.Option("--format", help="native, or holoocean: images and true poses.")
    ] = "native",
    overwrite: Overwrite = False,
) -> None:
    """Simulate a sequence with its truth."""
    from asfm.commands import simulate_to

    if (scene is None) == (scene_option is None):
        raise AsfmError("expected one scene, for example: asfm simulate seafloor --output scene")
    scene = scene or scene_option or ""

    with _show_progress() as progress:
        simulated = simulate_to(scene, output, sonar, frames, seed, overwrite, progress, motion, format_name)
    typer.echo(
        f"{_count(len(simulated), 'frame')} in {output}; reconstruct them with: asfm run {output} --output results"
    )
    _warn(simulated.diagnostics)


@app.command()
def denoise(
    sequences: Annotated[
        list[Path] | None, typer.Argument(help="Native folders with truth; none: simulate.", metavar="SEQUENCE")
    ] = None,
    frames: Annotated[
        int | None, typer.Option(help="Of each sequence (10 by default), or of each scene and sonar (1 by default).")
    ] = None,
    scenes: Annotated[
        list[str] | None, typer.Option("--scene", help="To simulate, all by default; may be repeated.", metavar="SCENE")
    ] = None,
    sonars: Annotated[
        list[str] | None, typer.Option("--sonar", help="To simulate, all by default; may be repeated.", metavar="SONAR")
    ] = None,
    seed: Annotated[int, typer.Option(help="Of the first simulated frame; each further one has the next.")] = 0,
    config: Annotated[Path | None, typer.Option(help="YAML file of settings that differ from the defaults.")] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", help="One setting; may be repeated.", metavar="SECTION.KEY=VALUE")
    ] = None,
    output: Annotated[Path | None, typer.Option(help="Folder for the table as CSV and JSON, and a picture.")] = None,
    overwrite: Overwrite = False,
) -> None:
    """Compare ways of denoising with the image without noise."""
    from asfm.commands import denoise_sources
    from asfm.commands.denoise_files import describe_denoising
    from asfm.config_file import load_config

    resolved = load_config(config, tuple(settings or ()))
    with _show_progress() as progress:
        table = denoise_sources(
            sequences or (), scenes or (), sonars or (), frames, seed, resolved, output, overwrite, progress
        )
    _say(describe_denoising(table))
    if output is not None:
        typer.echo(f"table and picture: {output}")


@app.command()
def convert(
    sequence: SequencePath,
    output: Annotated[Path, typer.Argument(help="Folder for the native sequence.", metavar="DIR")],
    overwrite: Overwrite = False,
) -> None:
    """Write a sequence of any format as a native folder."""
    from asfm.commands import convert_sequence

    with _show_progress() as progress:
        converted = convert_sequence(sequence, output, overwrite, progress)
    typer.echo(f"{_count(len(converted), 'frame')} in {output}")


@app.command()
def demo(
    frames: Annotated[int, typer.Option(help="How many.")] = 80,
    output: Annotated[Path, typer.Option(help="Folder for the sequence and the results.")] = Path("asfm-demo"),
) -> None:
    """Simulate, reconstruct and compare with the truth."""
    from asfm.commands import run_demo
    from asfm.commands.text import describe_results

    with _show_progress() as progress:
        summary = run_demo(output, frames, progress)
    _say(describe_results(summary))
    _warn(summary.diagnostics)
    typer.echo(f"all errors: asfm evaluate {summary.folder}")


def _show_version(asked: bool) -> None:
    if asked:
        typer.echo(f"asfm {__version__}")
        raise typer.Exit


def _say(lines: Iterable[str]) -> None:
    for line in lines:
        typer.echo(line)


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _warn(diagnostics: "Iterable[Diagnostic]") -> None:
    for item in diagnostics:
        typer.secho(f"{item.severity}: {item}", err=True, fg=None if item.severity == "info" else "yellow")


def _complain(message: str, code: int) -> int:
    """Say in one line why the exit code is not zero."""
    typer.echo(f"asfm: {' '.join(message.splitlines())}", err=True)
    return code


def _explain_usage(error: Exception) -> str:
    context = getattr(error, "ctx", None)
    command = context.command_path if context is not None else "asfm"
    return f"{error.format_message().rstrip('.')}; see {command} --help"  # type: ignore[attr-defined]


@contextmanager
def _show_progress() -> Iterator[Callable[[str, int, int], None]]:
    """Show bars on a terminal, and one plain line a stage where nobody watches."""
    if not sys.stderr.isatty():
        announced: list[str] = []

        def announce(stage: str, done: int, total: int) -> None:
            if stage not in announced:
                announced.append(stage)
                typer.echo(f"{stage}: {total} steps", err=True)

        yield announce
        return
    from rich import progress as bars
    from rich.console import Console

    columns = (bars.TextColumn("{task.description}"), bars.BarColumn(), bars.MofNCompleteColumn())
    with bars.Progress(*columns, bars.TimeElapsedColumn(), console=Console(stderr=True)) as display:
        tasks: dict[str, bars.TaskID] = {}

        def advance(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = display.add_task(stage, total=total)
            display.update(tasks[stage], completed=done, total=total)

        yield advance
