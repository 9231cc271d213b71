"""Time and memory of the back-end on the tracks of a long sequence."""

import multiprocessing
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

from asfm.backend.estimation.landmarks import describe_landmarks
from asfm.backend.estimation.solution import solve_tracks
from asfm.backend.graph.marginal_covariance import measure_uncertainty
from asfm.backend.initialisation.initial_poses import initialise_from_odometry
from asfm.config import Config
from asfm.evaluation.pose_error_table import ATE_RMSE, evaluate_sequence
from asfm.navigation.frame_navigation import read_navigation
from asfm.simulation.track_simulation import simulate_tracks
from asfm.stages import peak_memory_mb
from asfm.types import Trajectory
from tools.benchmark.table import Requirement

MAX_BATCH_S, MAX_BATCH_MB = 120.0, 3000.0
BATCH_FRAMES, BATCH_OBSERVATIONS, BATCH_VIEWS = 1000, 100, (10, 30)


@dataclass(frozen=True)
class Batch:
    """Time and memory of solving the tracks of a long sequence."""

    observations: int
    rounds_s: tuple[float, ...]
    """Of each round of solving."""
    landmarks_s: float
    peak_mb: float
    """Largest resident memory of the process."""
    ratio: float | None
    """ATE / odometry's ATE."""


def measure_batch(
    frames: int = BATCH_FRAMES, observations: int = BATCH_OBSERVATIONS, views: tuple[int, int] = BATCH_VIEWS
) -> Batch:
    """Solve the tracks of a long sequence in as many rounds as a run, and compute the landmarks' covariances."""
    floor, config = simulate_tracks(frames, observations, views, "transect", 5.0, navigation=True), Config()
    initial = initialise_from_odometry(read_navigation(floor.sequence, config.backend), floor.sequence)
    assert initial is not None
    poses, rounds_s = initial.world_from_vehicle, []
    for _ in range(config.backend.rounds):
        begin_s = time.perf_counter()
        solution = solve_tracks(floor.tracks, floor.sequence, poses, initial.sensors, config)
        poses = solution.bundle.world_from_vehicle
        rounds_s.append(time.perf_counter() - begin_s)
    begin_s = time.perf_counter()
    uncertainty = measure_uncertainty(solution.bundle, solution.elevation_information_ratio)
    describe_landmarks(solution, uncertainty.point_m2, floor.sequence, config)
    landmarks_s = time.perf_counter() - begin_s
    ratio = evaluate_sequence(floor.sequence, Trajectory(floor.sequence.timestamps_s, poses)).row(ATE_RMSE).ratio
    return Batch(len(floor.tracks), tuple(rounds_s), landmarks_s, peak_memory_mb(), ratio)


def list_batch_numbers(frames: int = BATCH_FRAMES, observations: int = BATCH_OBSERVATIONS) -> Iterator[Requirement]:
    """Measure a long sequence in a process of its own, so that its peak memory is its own."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        batch = pool.submit(measure_batch, frames, observations).result()
    title = f"{frames:,} frames"
    yield Requirement(f"{title}, observations of a frame", batch.observations / frames)
    for number, wall_s in enumerate(batch.rounds_s, start=1):
        yield Requirement(f"{title}, round {number}", wall_s, "s")
    yield Requirement(f"{title}, landmarks", batch.landmarks_s, "s")
    yield Requirement(f"{title}, in all", sum(batch.rounds_s) + batch.landmarks_s, "s", at_most=MAX_BATCH_S)
    yield Requirement(f"{title}, peak memory", batch.peak_mb, "MB", at_most=MAX_BATCH_MB)
    yield Requirement(f"{title}, ATE / odometry", batch.ratio)
