"""Shared matching: a reconstruction from stored features is the one that the pipeline makes by itself."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from asfm.config import Config
from asfm.pipeline import reconstruct
from asfm.sequence import Sequence
from asfm.simulation.simulate import simulate
from asfm.study.cell import Cell, External, Simulation
from asfm.study.cell_config import MODE_SETTINGS
from asfm.study.feature_cache import StudyCache
from asfm.study.shared_matching import KEYPOINTS, NOISE, list_requests, provide_matches
from asfm.types import Frame


def make_cells() -> list[Cell]:
    cells = []
    for filters in (("mutual", "ratio"), ("mutual", "ratio", "arc", "planar", "ssl")):
        for mode, settings in MODE_SETTINGS.items():
            config = Config.model_validate({"matching": {"filters": filters}, "backend": settings})
            source = Simulation("tank", "didson", None, 0, 5)
            cells.append(Cell(source, 0, mode, "akaze", str(len(filters)), "default", config, 0))
    return cells


@pytest.fixture(scope="module")
def sequence() -> Sequence:
    simulated = simulate("tank", "didson", 5).sequence
    frames = list(simulated)
    return replace(simulated, read_frame=frames.__getitem__)


def test_what_is_stored_gives_the_pipelines_own_result(sequence: Sequence, tmp_path: Path) -> None:
    cells, reads = make_cells(), list[int]()

    def read_frame(index: int) -> Frame:
        reads.append(index)
        return sequence.read_frame(index)

    counted = replace(sequence, read_frame=read_frame)
    requests = list_requests(cells)
    assert list(requests) == [cells[0].features_key] and len(requests[cells[0].features_key]) == 6
    for cell in (cells[0], cells[4], cells[5]):
        stored = provide_matches(cell, counted, requests[cell.features_key], StudyCache(tmp_path))
        config = cell.config.model_copy(update={"noise": stored.noise})
        assert stored.noise.range_bins != cell.config.noise.range_bins, "the noise is estimated, and stored"
        run = reconstruct(counted, config, extract=stored.extract)
        alone = reconstruct(sequence, cell.config)
        for name in ("world_from_vehicle", "timestamps_s"):
            one, other = (getattr(made.reconstruction.trajectory, name) for made in (run, alone))
            np.testing.assert_array_equal(one, other)
        np.testing.assert_array_equal(run.reconstruction.landmarks.xyz_m, alone.reconstruction.landmarks.xyz_m)
        assert [len(match) for match in run.matches] == [len(match) for match in alone.matches]
    noise_reads = [0, 1, 2, 3, 3, 4]
    assert reads[: 6 + 5] == noise_reads + list(range(5)), "pairs for the noise, then one pass over the images"
    (folder,) = (path for path in (tmp_path / "features").iterdir() if path.is_dir())
    stored_matches = [path for path in folder.iterdir() if path.name not in (KEYPOINTS, NOISE)]
    assert len(stored_matches) == 4, "two chains, with and without odometry: depth and attitude predict no poses"


def test_cells_with_external_matches_ask_for_nothing() -> None:
    cell = make_cells()[0]
    assert list_requests([replace(cell, external=External("mine", ""))]) == {}


def test_other_images_are_not_taken_for_the_stored_ones(sequence: Sequence, tmp_path: Path) -> None:
    cell = make_cells()[0]
    stored = provide_matches(cell, sequence, list_requests([cell])[cell.features_key], StudyCache(tmp_path))
    turned = replace(sequence, read_frame=lambda index: replace(sequence.read_frame(4 - index), index=index))
    for found, source in ((stored, sequence), (stored, turned)):
        config = cell.config.model_copy(update={"noise": found.noise})
        run = reconstruct(source, config, extract=found.extract)
        alone = reconstruct(source, cell.config)
        np.testing.assert_array_equal(run.keypoints[0].row_column, alone.keypoints[0].row_column)
