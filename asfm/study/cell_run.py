"""Run of a cell: its sequence and matches from the cache, the reconstruction, the metrics, its row."""

import errno
import time
import traceback
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from asfm.errors import AsfmError
from asfm.pipeline import Run, reconstruct
from asfm.simulation.simulate import add_sensors
from asfm.study.cell import Cell, Recording
from asfm.study.cell_metrics import Values, describe_failure, measure_cell
from asfm.study.external_matching import provide_external
from asfm.study.feature_cache import StudyCache
from asfm.study.fingerprint import hash_content
from asfm.study.match_corruption import CorruptedMatches, corrupt_matches
from asfm.study.match_pictures import write_match_picture
from asfm.study.results_table import describe_axes, write_row
from asfm.study.sequence_provider import StudySequence, check_sensors, provide_sequence
from asfm.study.shared_matching import MatchRequest, provide_matches
from asfm.study.track_bootstrap import resample_tracks
from asfm.study.true_tracks import TrueTracks, find_true_tracks
from asfm.types import ExternalMatches, Frame, Keypoints, Matches

CELLS, CACHE, LOGS = "cells", "cache", "logs"
"""Folders of a study."""


@dataclass(frozen=True)
class CellTask:
    """A cell, and what the cells that share its features need of them."""

    cell: Cell
    requests: tuple[MatchRequest, ...] = ()
    illustrated: bool = False
    """Whether a picture of its matches is made."""


def run_cell(task: CellTask, folder: Path) -> None:
    """Run a cell and write its row; a failure is a row with its error, and a defect leaves its traceback in a log.

    Args:
        task: the cell.
        folder: of the study.

    Raises:
        AsfmError: the row cannot be written, or the disk is full.
    """
    begin_s = time.perf_counter()
    values: Values
    try:
        values = _compute(task, folder)
    except Exception as error:  # whatever it was, the other cells go on, unless they would fail as well
        if is_disk_full(error):
            raise AsfmError(f"{error}; finished cells are kept: make room, and run the study again") from None
        values = {"error": describe_failure(error)}
        if values["error"].startswith("defect"):
            _log(folder / LOGS / f"{task.cell.id}.txt", f"{task.cell.label}\n\n{traceback.format_exc()}")
    values.setdefault("seconds", time.perf_counter() - begin_s)
    write_row(folder / CELLS / f"{task.cell.id}.parquet", {**describe_axes(task.cell), **values})


def is_disk_full(error: BaseException | None) -> bool:
    """Return whether an exception, or one that led to it, tells of a full disk."""
    while error is not None:
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
            return True
        error = error.__cause__ or error.__context__
    return False


def _log(path: Path, text: str) -> None:
    try:
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError:
        return  # the row still has the error


def _compute(task: CellTask, folder: Path) -> Values:
    cell, cache, corrupted = task.cell, StudyCache(folder / CACHE), None
    if cell.corruption is not None:
        opened = _open_with_true_tracks(cell, cache)
        check_sensors(opened.sequence, cell.mode)
        corrupted = _corrupt(cell, opened, cache)
        begin_s = time.perf_counter()
        run = reconstruct(opened.sequence, cell.config, external=corrupted.external)
    else:
        opened = provide_sequence(cell, cache)
        check_sensors(opened.sequence, cell.mode)
        if cell.external is not None:
            external = _perturb_external(cell, provide_external(cell, opened, cache))
            begin_s = time.perf_counter()
            run = reconstruct(opened.sequence, cell.config, external=external)
        else:
            begin_s = time.perf_counter()
            run = _reconstruct_by_detector(task, opened, cache)
    seconds = time.perf_counter() - begin_s
    if task.illustrated:
        write_match_picture(folder, cell, opened, run)
    return {**measure_cell(cell, run, opened, corrupted), "seconds": seconds}


def _reconstruct_by_detector(task: CellTask, opened: StudySequence, cache: StudyCache) -> Run:
    cell = task.cell
    stored = provide_matches(cell, opened.sequence, task.requests or _own_request(cell), cache)

    def extract(*stage: object) -> tuple[list[Keypoints], list[Matches]]:
        found = stored.extract(*stage)  # type: ignore[arg-type]
        return resample_tracks(*found, _generator(cell)) if _is_resampled(cell) else found

    config = cell.config.model_copy(update={"noise": stored.noise})
    return reconstruct(opened.sequence, config, extract=extract)


def _own_request(cell: Cell) -> tuple[MatchRequest, ...]:
    return (MatchRequest(cell.config.matching.filters, cell.config.backend),)


def _is_resampled(cell: Cell) -> bool:
    """Return whether the seed stands for a bootstrap sample: that of a recording, whose seed 0 is as recorded."""
    return isinstance(cell.sequence, Recording) and cell.seed > 0


def _perturb_external(cell: Cell, external: ExternalMatches) -> ExternalMatches:
    if not _is_resampled(cell):
        return external
    keypoints, matches = resample_tracks(external.keypoints, external.matches, _generator(cell))
    return ExternalMatches(tuple(keypoints), tuple(matches))


def _generator(cell: Cell) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(cell.seed, spawn_key=(1,)))


def _open_with_true_tracks(cell: Cell, cache: StudyCache) -> StudySequence:
    """Open the simulated sequence of seed 0, whose truth all seeds share, with the sensors of the cell's seed.

    Its images are not looked at.
    """
    opened = provide_sequence(replace(cell, seed=0), cache)
    sonar = opened.sequence.sonar
    blank = np.zeros(sonar.shape, dtype=np.float32)

    def read_frame(index: int) -> Frame:
        return Frame(index, float(opened.sequence.timestamps_s[index]), blank, np.zeros(sonar.shape, dtype=bool))

    return replace(opened, sequence=replace(add_sensors(opened.sequence, cell.seed), read_frame=read_frame))


def _corrupt(cell: Cell, opened: StudySequence, cache: StudyCache) -> CorruptedMatches:
    corruption, sequence = cell.corruption, opened.sequence
    assert corruption is not None and opened.read_truth is not None and sequence.groundtruth is not None
    read_truth, poses = opened.read_truth, sequence.groundtruth.world_from_vehicle @ sequence.vehicle_from_sonar
    frames = cell.config.frames.model_dump(mode="json")
    key = hash_content([replace(cell, seed=0).sequence_key, frames, corruption.points])

    def write(folder: Path) -> None:
        rng = np.random.default_rng(0)
        find_true_tracks(poses, sequence.sonar, read_truth, corruption.points, rng).write(folder / "tracks.npz")

    tracks = TrueTracks.read(cache.provide("true-tracks", key, write) / "tracks.npz")
    max_gap = cell.config.matching.max_gap
    return corrupt_matches(tracks, sequence.sonar, corruption, len(sequence), max_gap, _generator(cell))
