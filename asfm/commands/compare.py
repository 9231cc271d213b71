"""Command ``asfm compare``: the results of several runs side by side."""

from collections import Counter, defaultdict
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from asfm.atomic_folder import atomic_folder
from asfm.commands.compare_files import COMPARISON, write_comparison
from asfm.commands.evaluate import compare_with_truth
from asfm.config import Config
from asfm.config_file import load_config
from asfm.errors import AsfmError
from asfm.evaluation.evaluation_table import EvaluationTable
from asfm.evaluation.run_comparison import ComparedRun, RunComparison, RunLabels, compare_run, note_differences
from asfm.regular_file import is_present
from asfm.results.evaluation_json import read_evaluation, write_evaluation
from asfm.results.report_json import external_features, read_report
from asfm.results.results_folder import CONFIG, EVALUATION, REPORT
from asfm.stages import Progress, no_progress


def compare_folders(
    folders: Sequence[Path], output: Path | None = None, overwrite: bool = False, progress: Progress = no_progress
) -> RunComparison:
    """Compare the matcher quality and pose errors of finished runs.

    An evaluation.json that is newer than its run is read; else the run is evaluated, which writes it. For a run that
    cannot be evaluated, as without its sequence, a note stands, and the errors are those that the run itself wrote.

    Args:
        folders: results folders, one or more.
        output: folder for the table as CSV and the plot as SVG and PNG; nothing is written where it is None.
        overwrite: replace an earlier comparison in ``output``.
        progress: receives the progress.

    Raises:
        AsfmError: a folder is given twice, holds no results or damaged ones, or the output cannot be written.
    """
    _require_different(folders)
    reports = [read_report(folder) for folder in folders]
    configs = [_read_config(folder) for folder in folders]
    with ExitStack() as stack:
        partial = stack.enter_context(atomic_folder(output, COMPARISON, overwrite)) if output is not None else None
        labels = _name_runs(folders, reports, configs)
        runs, notes = list[ComparedRun](), list[str]()
        for done, (folder, report, own) in enumerate(zip(folders, reports, labels, strict=True)):
            progress("evaluate", done, len(folders))
            table, remarks = _evaluate(folder)
            runs.append(compare_run(own, _wall_s(report), table))
            if table is not None and table.reference is not None:
                remarks.append(f"compared with {table.reference} in place of the true poses of the sequence")
            notes += [f"{own.run}: {remark}" for remark in remarks]
        progress("evaluate", len(folders), len(folders))
        comparison = RunComparison(tuple(runs), (*note_differences(tuple(runs)), *notes))
        if partial is not None:
            missing = write_comparison(partial, comparison)
            comparison = RunComparison(comparison.runs, (*comparison.notes, *missing))
    return comparison


def _require_different(folders: Sequence[Path]) -> None:
    if not folders:
        raise AsfmError("expected one or more results folders, found none")
    for folder, count in Counter(folder.resolve() for folder in folders).items():
        if count > 1:
            raise AsfmError(f"{folder}: expected each results folder once, found it {count} times")


def _read_config(folder: Path) -> Config:
    if not is_present(folder / CONFIG):
        raise AsfmError(f"{folder}: expected a folder that asfm run wrote, found no {CONFIG} in it")
    return load_config(folder / CONFIG)


def _evaluate(folder: Path) -> tuple[EvaluationTable | None, list[str]]:
    """Read or make the evaluation of a run; returns it, and what stands in its way."""
    if is_present(folder / EVALUATION) and _modified_ns(folder / EVALUATION) > _modified_ns(folder / REPORT):
        return read_evaluation(folder), []
    try:
        table = compare_with_truth(folder)
    except AsfmError as error:
        if is_present(folder / EVALUATION):
            return read_evaluation(folder), [f"only what the run itself evaluated: {error}"]
        return None, [f"not evaluated: {error}"]
    try:
        write_evaluation(folder, table)
    except AsfmError as error:
        return table, [str(error)]
    return table, []


def _modified_ns(path: Path) -> int:
    try:
        return path.stat().st_mtime_ns
    except OSError as error:
        raise AsfmError(f"{path}: cannot read: {error.strerror}") from None


def _wall_s(report: dict[str, Any]) -> float | None:
    seconds = report.get("wall_s")
    return float(seconds) if isinstance(seconds, int | float) and abs(seconds) < 1e12 else None


def _name_runs(folders: Sequence[Path], reports: list[dict[str, Any]], configs: list[Config]) -> list[RunLabels]:
    """Name every run by its folder, and every sequence by its name, or by the whole path where that is not enough."""
    names = [folder.resolve().name for folder in folders]
    runs = [str(folder) if names.count(name) > 1 else name for folder, name in zip(folders, names, strict=True)]
    paths = defaultdict[str, set[str]](set)
    for report in reports:
        paths[_sequence_name(report)].add(report["sequence"]["path"])
    labels = []
    for run, report, config in zip(runs, reports, configs, strict=True):
        name = _sequence_name(report)
        sequence = name if len(paths[name]) == 1 else str(report["sequence"]["path"])
        labels.append(RunLabels(run, sequence + _describe_frames(config), _describe_matcher(report, config)))
    return labels


def _sequence_name(report: dict[str, Any]) -> str:
    name = report["sequence"].get("name")
    return name if isinstance(name, str) else Path(report["sequence"]["path"]).name


def _describe_frames(config: Config) -> str:
    """Return which frames of the recording are used; nothing where all are."""
    first, last, every = config.frames.first, config.frames.last, config.frames.every
    if (first, last, every) == (0, None, 1):
        return ""
    span = f" frames {first}-{'' if last is None else last}"
    return span if every == 1 else f"{span} every {every}"


def _describe_matcher(report: dict[str, Any], config: Config) -> str:
    """Return the detector, or the file of external keypoints, and the filters."""
    external = external_features(report)
    if external is not None:
        detector = f"external {external.parent.name}/{external.name}"
    else:
        detector = config.keypoints.detector + (" fan" if config.keypoints.space == "fan" else "")
        detector += " guided" if config.matching.guided else ""
    return f"{detector}, {'+'.join(config.matching.filters) or 'no filter'}"
