"""Options of the commands with many of them, as one frozen dataclass per command."""

from collections.abc import Callable
from dataclasses import MISSING, dataclass, fields
from inspect import Parameter, Signature
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_type_hints

from typer import Argument, Option

Options = TypeVar("Options")

SequencePath = Annotated[Path, Argument(help="Folder or file in any supported format.", metavar="SEQUENCE")]
ResultsPath = Annotated[Path, Argument(help="Results folder written by asfm run.", metavar="DIR")]
RecordingPath = Annotated[Path, Argument(help="Results folder written by asfm run, or a .rrd file.", metavar="DIR")]
ConfigPath = Annotated[Path | None, Option(help="YAML file of settings that differ from the defaults.")]
Settings = Annotated[
    list[str] | None,
    Option("--set", help="One setting, overrides --config; may be repeated.", metavar="SECTION.KEY=VALUE"),
]
Overwrite = Annotated[bool, Option("--overwrite", help="Replace earlier output of asfm.")]


def takes_options(options: type[Options]) -> Callable[[Callable[[Options], None]], Callable[..., None]]:
    """Return a decorator that gives a command the fields of a dataclass as parameters.

    Typer reads names, types, help texts and defaults from the signature of a function. The decorated function has the
    fields as its signature and calls the command with one object of the dataclass.

    Args:
        options: dataclass whose fields have the type ``Annotated[..., typer.Option(...)]`` or ``typer.Argument``.
    """
    hints = get_type_hints(options, include_extras=True)
    parameters = [
        Parameter(
            field.name,
            Parameter.KEYWORD_ONLY,
            default=Parameter.empty if field.default is MISSING else field.default,
            annotation=hints[field.name],
        )
        for field in fields(options)  # type: ignore[arg-type]
    ]

    def decorate(command: Callable[[Options], None]) -> Callable[..., None]:
        def call(**values: Any) -> None:
            command(options(**values))

        call.__name__, call.__doc__ = command.__name__, command.__doc__
        call.__annotations__ = hints
        call.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
        return call

    return decorate


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Options of ``asfm run``."""

    sequence: SequencePath
    output: Annotated[Path, Option(help="Folder for the results.")]
    config: ConfigPath = None
    settings: Settings = None
    mode: Annotated[str | None, Option(help="Order in which frames are processed: batch.")] = None
    rerun: Annotated[bool, Option("--rerun/--no-rerun", help="Write a recording for the Rerun viewer.")] = True
    features: Annotated[Path | None, Option(help="External keypoints: an HDF5 file of hloc.")] = None
    matches: Annotated[Path | None, Option(help="External matches of these keypoints: an HDF5 file of hloc.")] = None
    overwrite: Overwrite = False


@dataclass(frozen=True, kw_only=True)
class SimulateOptions:
    """Options of ``asfm simulate``."""

    output: Annotated[Path, Option(help="Folder for the sequence.")]
    scene: Annotated[
        str | None,
        Argument(
            metavar="SCENE", help="Scene (seafloor, pier, hull ...; an unknown name lists all of them), or a mesh file."
        ),
    ] = None
    scene_option: Annotated[str | None, Option("--scene", help="Same as the argument SCENE.", metavar="SCENE")] = None
    sonar: Annotated[
        str, Option(help="Sonar preset (an unknown name lists all of them), or a HoloOcean scenario (.json).")
    ] = "oculus_m750d_high"
    frames: Annotated[int, Option(help="Number of frames.")] = 80
    seed: Annotated[int, Option(help="Random seed; equal seeds give identical files.")] = 0
    motion: Annotated[
        str | None,
        Option(
            help="Motion (an unknown name lists all of them), or a TUM file of vehicle poses.",
            metavar="NAME|FILE.tum",
        ),
    ] = None
    format_name: Annotated[
        str, Option("--format", help="Output format: native, or holoocean (images and true poses only).")
    ] = "native"
    overwrite: Overwrite = False


@dataclass(frozen=True, kw_only=True)
class DenoiseOptions:
    """Options of ``asfm denoise``."""

    sequences: Annotated[
        list[Path] | None,
        Argument(help="Native folders with truth; frames are simulated where none is given.", metavar="SEQUENCE"),
    ] = None
    frames: Annotated[
        int | None,
        Option(help="Frames of each sequence (10 by default), or of each scene and sonar (1 by default)."),
    ] = None
    scenes: Annotated[
        list[str] | None,
        Option("--scene", help="Scene to simulate, all by default; may be repeated.", metavar="SCENE"),
    ] = None
    sonars: Annotated[
        list[str] | None,
        Option("--sonar", help="Sonar to simulate, all by default; may be repeated.", metavar="SONAR"),
    ] = None
    seed: Annotated[int, Option(help="Seed of the first simulated frame; each further frame has the next seed.")] = 0
    config: ConfigPath = None
    settings: Settings = None
    output: Annotated[Path | None, Option(help="Folder for the table as CSV and JSON, and a picture.")] = None
    overwrite: Overwrite = False


@dataclass(frozen=True, kw_only=True)
class StudyOptions:
    """Options of ``asfm study``."""

    study: Annotated[Path, Argument(help="Study file (YAML).", metavar="STUDY")]
    output: Annotated[Path | None, Option(help="Folder of the study; finished cells in it are kept.")] = None
    jobs: Annotated[int | None, Option(help="Number of processes; by default that of the cores.")] = None
    scheduler: Annotated[
        str | None, Option(help="Run the cells on the workers of this Dask scheduler, such as tcp://host:8786.")
    ] = None
    cluster: Annotated[Path | None, Option(help="Start a Dask cluster by this file (YAML) for the cells.")] = None
    dry_run: Annotated[bool, Option("--dry-run", help="Show the grid and an estimate of its time, run nothing.")] = (
        False
    )
    retry_failed: Annotated[bool, Option("--retry-failed", help="Run the cells again that have failed.")] = False
