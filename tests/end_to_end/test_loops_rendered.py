"""Loops on rendered images of a round trip: over rocks of which no two are alike, and over the same ones repeated."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, lru_cache

import numpy as np

from asfm.backend.estimation.solution import Solution, solve_tracks
from asfm.backend.initialisation.initial_poses import InitialPoses
from asfm.config import BackendConfig, Config, LoopsConfig
from asfm.evaluation.true_positions import look_up_elevation
from asfm.frontend.tracking.association import associate
from asfm.geometry.poses import invert, transform
from asfm.geometry.sonar import back_project, project
from asfm.navigation.frame_navigation import read_navigation
from asfm.navigation.pose_prediction import predict_poses
from asfm.pipeline import loop_closure as loops
from asfm.pipeline.feature_matching import extract_matches
from asfm.pipeline.reconstruction import initialise, optimise
from asfm.recorder import NullRecorder
from asfm.sequence import Sequence
from asfm.simulation.scenes.scene import Scene, join_scenes
from asfm.simulation.scenes.shapes import Mesh, make_rock, make_sheet, move_mesh
from asfm.simulation.simulate import find_sonar, simulate_path
from asfm.simulation.vehicle.trajectories import View, look_at, make_sway
from asfm.stages import StageClock, StageReport
from asfm.types import BoolArray, FloatArray, Keypoints, Matches, SensorNoise, Trajectory

FRAMES = 70
SPACING_M = 2.5
"""Between one group of rocks and the next."""
REACH_M = 7.5
ROCKS = 9
"""In a group."""
NOISE = SensorNoise(0.06, np.deg2rad(0.9), 0.01, 0.0035, 0.0035)
"""An odometry that drifts by a third of a metre in the course of the sequence."""
CONFIG = Config(backend=BackendConfig(use_navigation=False))
ALONE = Config(backend=BackendConfig(use_odometry=False, use_navigation=False))


@dataclass(frozen=True)
class RoundTrip:
    """A sequence that goes out and comes back, and what is true of it."""

    sequence: Sequence
    world_from_sonar: FloatArray
    """(N, 4, 4), the vehicle's as well."""
    read_elevation_rad: Callable[[int], FloatArray]
    """Of a frame, in pixels; rendered when it is asked for."""

    def are_right(self, matches: Matches, keypoints: list[Keypoints]) -> BoolArray:
        """Return which matches (M,) join keypoints of one true point."""
        a, b = keypoints[matches.frame_a], keypoints[matches.frame_b]
        of_a, of_b = matches.index.T
        b_from_a = invert(self.world_from_sonar[matches.frame_b]) @ self.world_from_sonar[matches.frame_a]
        elevation_rad, known = look_up_elevation(a.row_column[of_a], self.read_elevation_rad(matches.frame_a))
        points = back_project(a.range_m[of_a], a.bearing_rad[of_a], np.where(known, elevation_rad, 0.0))
        range_m, bearing_rad, _ = project(transform(b_from_a, points))
        near = (abs(range_m - b.range_m[of_b]) < 0.12) & (abs(bearing_rad - b.bearing_rad[of_b]) < np.deg2rad(1.5))
        return np.asarray(known & near)

    def error_m(self, world_from_sonar: FloatArray) -> float:
        """Root mean square of the positions' errors after the best rigid motion (Kabsch 1976)."""
        found, true = (
            poses[:, :3, 3] - poses[:, :3, 3].mean(axis=0) for poses in (world_from_sonar, self.world_from_sonar)
        )
        u, _, v = np.linalg.svd(found.T @ true)
        turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v
        return float(np.sqrt(np.mean(np.sum((found @ turn - true) ** 2, axis=1))))


@lru_cache(maxsize=2)
def render_round_trip(repeated: bool, seed: int) -> RoundTrip:
    """Look at a row of groups of rocks along y, from its middle to one end and back."""
    rng = np.random.default_rng(seed)
    scene = _make_rocks(rng, repeated)
    sonar = find_sonar("didson").sonar
    view = View((0.0, 0.0, 0.0), 0.0, np.deg2rad(25.0), 0.6 * sonar.range_max)
    times_s = np.arange(FRAMES) / sonar.rate_hz
    along_m = REACH_M * np.sin(np.pi * times_s / times_s[-1])
    target_m = np.stack([np.zeros(FRAMES), along_m, np.zeros(FRAMES)], axis=1)
    poses = look_at(view, target_m, 0.0) @ make_sway(view, times_s, 0.3, rng)
    simulated = simulate_path(scene, sonar, Trajectory(times_s, poses), seed, noise=NOISE, drift=None)
    frames = list(simulated.sequence)
    read_elevation_rad = cache(lambda index: simulated.read_truth(index).elevation_rad)
    return RoundTrip(replace(simulated.sequence, read_frame=frames.__getitem__), poses, read_elevation_rad)


def _make_rocks(rng: np.random.Generator, repeated: bool) -> Scene:
    parts = [_as_scene(make_sheet((16.0, 30.0), 0.25), 0.15)]
    group = [_make_rock(rng) for _ in range(ROCKS)]
    for number in range(-7, 8):
        rocks = group if repeated else [_make_rock(rng) for _ in range(ROCKS)]
        parts += [_as_scene(move_mesh(mesh, (0.0, number * SPACING_M, 0.0)), level) for mesh, level in rocks]
    return join_scenes("rocks", parts)


def _make_rock(rng: np.random.Generator) -> tuple[Mesh, float]:
    rock = make_rock(float(rng.uniform(0.1, 0.3)), rng)
    place_m = rng.uniform([-1.2, -0.8, 0.0], [1.2, 0.8, 0.1])
    return move_mesh(rock, place_m.tolist()), float(rng.uniform(0.5, 1.0))


def _as_scene(mesh: Mesh, level: float) -> Scene:
    return Scene("part", *mesh, np.full(len(mesh[1]), level))


@lru_cache(maxsize=4)
def solve_first_round(
    repeated: bool, seed: int, config: Config
) -> tuple[list[Keypoints], list[Matches], InitialPoses, Solution]:
    """Run the pipeline up to its search for loops."""
    sequence, clock = render_round_trip(repeated, seed).sequence, StageClock()
    navigation = read_navigation(sequence, config.backend)
    prediction = predict_poses(navigation, sequence)
    keypoints, candidates = extract_matches(sequence, config, NullRecorder(), clock, prediction)
    keypoints = [frame.without_patches() for frame in keypoints]
    start = initialise(sequence, navigation, keypoints, candidates, config, clock)
    tracks = associate(keypoints, candidates, sequence.sonar, start.world_from_vehicle, config)
    return keypoints, candidates, start, solve_tracks(tracks, sequence, start.world_from_vehicle, start.sensors, config)


def test_rocks_that_repeat_themselves_close_no_wrong_loop_without_odometry() -> None:
    """Toward the end of the row few tracks last from frame to frame, and the next group may be taken for the last.

    The loops of the middle, where the tracks hold on, are found.
    """
    trip = render_round_trip(True, 1)
    keypoints, _, _, solution = solve_first_round(True, 1, ALONE)
    report = StageReport("loops")
    closure = loops.find_loops(trip.sequence, keypoints, solution, ALONE, report)
    right = [float(np.mean(trip.are_right(match, keypoints))) for match in closure.matches]
    assert len(right) >= 5
    assert min(right) > 0.6
    before_m = trip.error_m(solution.bundle.world_from_vehicle)
    assert trip.error_m(closure.world_from_vehicle) < 1.05 * before_m


def test_the_way_back_closes_right_loops_that_take_the_drift_away() -> None:
    trip = render_round_trip(False, 2)
    keypoints, candidates, start, solution = solve_first_round(False, 2, CONFIG)
    closure = loops.find_loops(trip.sequence, keypoints, solution, CONFIG, StageReport("loops"))
    right = [float(np.mean(trip.are_right(match, keypoints))) for match in closure.matches]
    assert len(right) >= 5
    assert min(right) > 0.6
    without = CONFIG.model_copy(update={"loops": LoopsConfig(enabled=False)})
    with_m, without_m = (
        trip.error_m(
            optimise(trip.sequence, keypoints, candidates, start, config, StageClock()).bundle.world_from_vehicle
        )
        for config in (CONFIG, without)
    )
    assert with_m < 0.6 * without_m
