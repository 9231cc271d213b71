"""The commands of the command line: each parses its options, calls asfm.commands and prints the result."""

from pathlib import Path
from typing import Annotated

import typer

from asfm import __version__
from asfm.cli.options import (
    DenoiseOptions,
    Overwrite,
    RecordingPath,
    ResultsPath,
    RunOptions,
    SequencePath,
    SimulateOptions,
    StudyOptions,
    takes_options,
)
from asfm.cli.progress import show_countdown, show_progress
from asfm.cli.terminal import format_count, print_diagnostics, print_lines
from asfm.errors import AsfmError

DESCRIPTION = "Acoustic structure from motion for forward-looking imaging sonar."

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    help=DESCRIPTION,
)


def _print_version(requested: bool) -> None:
    if requested:
        print_lines([f"asfm {__version__}"])
        raise typer.Exit


@app.callback(help=DESCRIPTION)
def asfm(
    version: Annotated[
        bool, typer.Option("--version", help="Show the version.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """Handle the options of asfm itself."""


@app.command()
@takes_options(RunOptions)
def run(options: RunOptions) -> None:
    """Reconstruct the trajectory and a 3-D point map of a sequence."""
    from asfm.config_file import load_config

    overrides = tuple(options.settings or ()) + (() if options.mode is None else (f"mode={options.mode}",))
    config = load_config(options.config, overrides)
    if (options.features is None) != (options.matches is None):
        raise AsfmError("--features and --matches: expected both or neither, found one")
    from asfm.commands import run_sequence  # after the checks above, which need little
    from asfm.commands.text import describe_results

    external = None if options.features is None or options.matches is None else (options.features, options.matches)
    with show_progress() as progress:
        summary = run_sequence(
            options.sequence,
            options.output,
            config,
            recording=options.rerun,
            overwrite=options.overwrite,
            progress=progress,
            external_matches=external,
        )
    print_lines(describe_results(summary))
    print_diagnostics(summary.diagnostics)


@app.command()
def info(sequence: SequencePath) -> None:
    """Describe a sequence: frames, sonar, navigation and ground truth."""
    from asfm.commands import describe_sequence
    from asfm.commands.text import align

    print_lines(align(describe_sequence(sequence)))


@app.command()
def evaluate(
    results: ResultsPath,
    reference: Annotated[
        Path | None, typer.Option(help="TUM file of true poses, instead of those of the sequence.")
    ] = None,
) -> None:
    """Compare a run, and its odometry, with ground truth."""
    from asfm.commands import evaluate_folder
    from asfm.commands.text import describe_errors

    print_lines(describe_errors(evaluate_folder(results, reference)))


@app.command()
def compare(
    results: Annotated[list[Path], typer.Argument(help="Results folders written by asfm run.", metavar="RESULTS...")],
    output: Annotated[
        Path | None, typer.Option(help="Folder for the table as CSV, and a plot of precision against ATE.")
    ] = None,
    overwrite: Overwrite = False,
) -> None:
    """Compare runs side by side: matcher quality and pose errors."""
    from asfm.commands import compare_folders
    from asfm.commands.compare_files import describe_comparison

    with show_progress() as progress:
        comparison = compare_folders(results, output, overwrite, progress)
    print_lines(describe_comparison(comparison))
    if output is not None:
        print_lines([f"table and plot: {output}"])


@app.command()
@takes_options(StudyOptions)
def study(options: StudyOptions) -> None:
    """Run a grid of matchers and report their pose errors."""
    from asfm.commands.study_text import describe_plan, describe_study

    if options.dry_run:
        from asfm.commands import plan_study

        print_lines(describe_plan(plan_study(options.study)))
        return
    if options.study.is_file() and options.scheduler is None and options.cluster is None:
        from asfm.study.fork_server import start_fork_server

        start_fork_server()  # before the imports below, beside which it loads its own
    from asfm.commands import run_study
    from asfm.commands.study import require_success
    from asfm.study.study_run import RunSettings

    settings = RunSettings(options.jobs, options.retry_failed, options.scheduler, options.cluster)
    with show_countdown("study") as report:
        summary = run_study(options.study, options.output, settings, report)
    print_lines(describe_study(summary))
    require_success(summary)


@app.command()
def view(results: RecordingPath) -> None:
    """Open the recording of a run in the Rerun viewer."""
    from asfm.commands import view_folder

    view_folder(results)


@app.command()
@takes_options(SimulateOptions)
def simulate(options: SimulateOptions) -> None:
    """Simulate a sequence with ground truth."""
    from asfm.commands import SimulationOptions, simulate_to

    if (options.scene is None) == (options.scene_option is None):
        raise AsfmError("expected one scene, for example: asfm simulate seafloor --output scene")
    scene = options.scene or options.scene_option or ""
    simulation = SimulationOptions(options.sonar, options.frames, options.seed, options.motion, options.format_name)
    with show_progress() as progress:
        simulated = simulate_to(scene, options.output, simulation, options.overwrite, progress)
    count, output = format_count(len(simulated), "frame"), options.output
    print_lines([f"{count} in {output}; reconstruct them with: asfm run {output} --output results"])
    print_diagnostics(simulated.diagnostics)


@app.command()
@takes_options(DenoiseOptions)
def denoise(options: DenoiseOptions) -> None:
    """Compare denoising methods against noise-free images."""
    from asfm.commands import DenoiseSources, denoise_sources
    from asfm.commands.denoise_files import describe_denoising
    from asfm.config_file import load_config

    config = load_config(options.config, tuple(options.settings or ()))
    sources = DenoiseSources(
        options.sequences or (), options.scenes or (), options.sonars or (), options.frames, options.seed
    )
    with show_progress() as progress:
        table = denoise_sources(sources, config, options.output, options.overwrite, progress)
    print_lines(describe_denoising(table))
    if options.output is not None:
        print_lines([f"table and picture: {options.output}"])


@app.command()
def convert(
    sequence: SequencePath,
    output: Annotated[Path, typer.Argument(help="Folder for the native sequence.", metavar="DIR")],
    overwrite: Overwrite = False,
) -> None:
    """Convert a sequence of any format to a native folder."""
    from asfm.commands import convert_sequence

    with show_progress() as progress:
        converted = convert_sequence(sequence, output, overwrite, progress)
    print_lines([f"{format_count(len(converted), 'frame')} in {output}"])


@app.command()
def demo(
    frames: Annotated[int, typer.Option(help="Number of frames.")] = 80,
    output: Annotated[Path, typer.Option(help="Folder for the sequence and the results.")] = Path("asfm-demo"),
) -> None:
    """Simulate, reconstruct and evaluate an example."""
    from asfm.commands import run_demo
    from asfm.commands.text import describe_results

    with show_progress() as progress:
        summary = run_demo(output, frames, progress)
    print_lines(describe_results(summary))
    print_diagnostics(summary.diagnostics)
    print_lines([f"all errors: asfm evaluate {summary.folder}"])
