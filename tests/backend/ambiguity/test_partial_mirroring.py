"""Partially mirrored solutions are detected and corrected; others are returned unchanged."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.backend.ambiguity.partial_mirroring import (
    MIN_LOG_ODDS,
    _triangulation_cost,
    compare_fits,
    correct_partial_mirroring,
    find_local_minimum,
    scan_mirror_frames,
)
from asfm.backend.ambiguity.reflection import reflect_after
from asfm.backend.estimation.residual_gate import GUESSED_SLACK, make_residual_gate
from asfm.backend.estimation.solution import solve_tracks
from asfm.backend.estimation.triangulation import triangulate_tracks
from asfm.config_file import load_config
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import SonarModel, project
from asfm.navigation.sensor_constraints import SensorConstraints
from asfm.sequence import Sequence
from asfm.types import FloatArray, IntArray, Tracks
from tests.worlds import make_constraints, no_frame

SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.7, 0.7), (1500, 256), np.deg2rad(20))
LEVER_ARM = make_pose(np.array([0.2, -0.1, -0.1]), Rotation.from_euler("ZYX", [0.1, 0.05, 0.0]))
FRAMES, FLIP = 41, 20


def make_motion() -> FloatArray:
    """Make (N, 4, 4) poses from the identity on, with an oscillating roll that rests around the middle."""
    along = np.arange(FRAMES) - FLIP
    roll = 0.35 * np.sin(along / 7) ** 3
    yaw = 0.2 * np.sin(along / 9)
    position = np.stack([0.2 * np.sin(along / 8), 0.1 * along, 0.05 * np.sin(along / 6)], axis=1)
    poses = make_pose(position, Rotation.from_euler("ZYX", np.stack([yaw, 0 * yaw, roll], axis=1)))
    return np.asarray(invert(poses[0]) @ poses)


def make_tracks(poses: FloatArray) -> Tracks:
    """Make tracks of up to fifteen frames each, with little noise."""
    rng = np.random.default_rng(7)
    middle = rng.integers(0, FRAMES, 500)
    in_sonar = rng.uniform([3.0, -1.5, -0.5], [6.0, 1.5, 0.5], (500, 3))
    points = transform((poses @ LEVER_ARM)[middle], in_sonar)
    seen = transform(invert(poses @ LEVER_ARM), points[:, None])
    near = np.abs(np.arange(FRAMES) - middle[:, None]) <= 7
    long = (SONAR.sees(seen) & near).sum(axis=1) >= 5
    track, frame = np.nonzero(SONAR.sees(seen)[long] & near[long])
    range_m, bearing_rad, _ = project(seen[long][track, frame])
    sigma = np.tile([0.01, 0.003], (len(track), 1))
    error = rng.normal(0, 0.3, (len(track), 2)) * sigma
    return Tracks(track, frame, range_m + error[:, 0], bearing_rad + error[:, 1], sigma=sigma)


def make_case(measured: bool = False) -> tuple[Tracks, Sequence, SensorConstraints, FloatArray]:
    truth = make_motion()
    sequence = Sequence("made up", SONAR, np.arange(FRAMES, dtype=float), no_frame, LEVER_ARM)
    held = truth if measured else np.repeat(np.eye(4)[None], FRAMES, axis=0)
    sensors = make_constraints(sequence, held, np.tile([0.08, 0.15], (FRAMES - 1, 1)), measured)
    return make_tracks(truth), sequence, sensors, truth


def roll_rad(world_from_vehicle: FloatArray) -> FloatArray:
    return np.asarray(Rotation.from_matrix(world_from_vehicle[:, :3, :3]).as_euler("ZYX")[:, 2])


def test_a_partially_mirrored_solution_is_corrected() -> None:
    tracks, sequence, sensors, truth = make_case()
    config = load_config()
    mirrored = solve_tracks(tracks, sequence, reflect_after(truth, FLIP, LEVER_ARM), sensors, config)
    frames, increase = scan_mirror_frames(
        tracks, mirrored.bundle.world_from_vehicle, sequence, make_residual_gate(tracks, sequence, sensors, config)
    )
    found = find_local_minimum(frames, increase)
    assert found is not None and abs(found - FLIP) <= 6
    corrected = correct_partial_mirroring(mirrored, sequence, config)
    before, after = (
        roll_rad(solution.bundle.world_from_vehicle) - roll_rad(truth) for solution in (mirrored, corrected)
    )
    assert np.abs(before).max() > 0.3 > 0.1 > np.abs(after).max(), (
        "the optimisation alone does not leave the local optimum"
    )
    residual_gate = make_residual_gate(tracks, sequence, sensors, config)
    assert compare_fits(mirrored, corrected, sequence, residual_gate, 1.0) > MIN_LOG_ODDS
    assert compare_fits(corrected, corrected, sequence, residual_gate, 1.0) == 0


@pytest.mark.parametrize("prepare", ["correct", "odometry", "attitude", "no observations"])
def test_other_solutions_are_returned_unchanged(prepare: str) -> None:
    tracks, sequence, sensors, truth = make_case(measured=prepare == "odometry")
    solution = solve_tracks(tracks, sequence, truth, sensors, load_config())
    if prepare == "attitude":
        solution = replace(solution, problem=replace(solution.problem, sensors=with_attitude(sensors)))
    if prepare == "no observations":
        solution = replace(solution, observed=np.zeros(len(tracks), dtype=bool))
    assert correct_partial_mirroring(solution, sequence, load_config()) is solution


def with_attitude(sensors: SensorConstraints) -> SensorConstraints:
    return replace(sensors, z_roll_pitch=np.zeros((FRAMES, 3)), z_roll_pitch_sigma=np.ones((FRAMES, 3)))


def test_local_minima_need_significantly_higher_values_on_both_sides() -> None:
    frames = np.arange(2, 23, 3)
    assert find_local_minimum(frames, np.array([0.0, 0.2, 0.1, 0.3, 0.9, 0.4, 0.01])) == 8
    assert find_local_minimum(frames, np.array([0.0, 0.2, 0.16, 0.3, 0.9, 0.4, 0.01])) is None, "not significant"
    assert find_local_minimum(frames, np.array([0.0, 0.2, 0.4, 0.9, 0.5, 0.2, 0.1])) is None
    assert find_local_minimum(frames[:2], np.array([0.1, 0.0])) is None
    assert find_local_minimum(frames[:0], np.zeros(0)) is None


@pytest.mark.parametrize(
    ("log_odds", "attitude", "taken"), [(-0.1, False, False), (0.1, False, True), (0.1, True, False)]
)
def test_another_solution_needs_strong_odds_and_no_attitude(
    monkeypatch: pytest.MonkeyPatch, log_odds: float, attitude: bool, taken: bool
) -> None:
    """A flip is seen at every call, and the odds are below or above those required."""
    module = "asfm.backend.ambiguity.partial_mirroring"
    tracks, sequence, sensors, truth = make_case()
    problem = SimpleNamespace(sensors=with_attitude(sensors) if attitude else sensors)
    bundle = SimpleNamespace(world_from_vehicle=truth)
    given: Any = SimpleNamespace(tracks=tracks, bundle=bundle, problem=problem, observed=np.ones(3, dtype=bool))
    monkeypatch.setattr(f"{module}.scan_mirror_frames", lambda *_: (np.zeros(0), np.zeros(0)))
    monkeypatch.setattr(f"{module}.find_local_minimum", lambda *_: FLIP)
    monkeypatch.setattr(f"{module}.solve_tracks", lambda *_: "other")
    monkeypatch.setattr(f"{module}.compare_fits", lambda *_: MIN_LOG_ODDS + log_odds)
    assert correct_partial_mirroring(given, sequence, load_config()) == ("other" if taken else given)


def test_log_odds_are_those_of_a_plain_loop() -> None:
    """Truncated squares of the tracks in both solutions, each over 1 + (n - 1) rho, without the slack."""
    tracks, sequence, sensors, truth = make_case()
    rng, gate = np.random.default_rng(0), make_residual_gate(tracks, sequence, sensors, load_config())
    points = triangulate_tracks(tracks, truth @ LEVER_ARM, SONAR, gate.sigma, gate.gate).xyz_m
    solutions: list[Any] = []
    for error_m in (0.3, 0.05):
        in_graph, xyz_m = rng.random(tracks.count) < 0.8, points + rng.normal(0, error_m, points.shape)
        bundle = SimpleNamespace(world_from_vehicle=truth, xyz_m=xyz_m, in_graph=in_graph)
        solutions.append(SimpleNamespace(tracks=tracks, bundle=bundle))
    expected = 0.0
    for row, (track, frame) in enumerate(zip(tracks.track.tolist(), tracks.frame.tolist(), strict=True)):
        if not all(solution.bundle.in_graph[track] for solution in solutions):
            continue
        weight = 1 / (1 + 0.4 * (np.sum(tracks.track == track) - 1))
        for sign, solution in zip((1, -1), solutions, strict=True):
            x, y, z, _ = np.linalg.inv(truth[frame] @ LEVER_ARM) @ [*solution.bundle.xyz_m[track], 1.0]
            errors = np.array([np.sqrt(x * x + y * y + z * z) - tracks.range_m[row], np.arctan2(y, x)])
            errors[1] -= tracks.bearing_rad[row]
            outside = max(abs(np.arctan2(z, np.hypot(x, y))) - gate.gate.half_aperture_rad, 0) / gate.gate.edge_rad
            square = min(np.sum((errors / gate.sigma[row]) ** 2) + outside**2, gate.gate.truncation**2)
            expected += sign * weight * square * GUESSED_SLACK**2 / 2
    assert compare_fits(solutions[0], solutions[1], sequence, gate, 0.4) == pytest.approx(expected)
    assert expected > 10


def test_an_outlier_adds_no_more_than_its_truncated_square_to_the_cost_of_a_frame() -> None:
    tracks, sequence, sensors, truth = make_case()
    gate, chosen = make_residual_gate(tracks, sequence, sensors, load_config()), np.arange(20)
    off_m = np.where(np.arange(len(tracks)) == np.flatnonzero(tracks.track == 7)[3], 1.0, 0.0)
    right, wrong = (
        _triangulation_cost(replace(tracks, range_m=tracks.range_m + by), chosen, truth, sequence, gate)
        for by in (0.0, off_m)
    )
    assert 0.9 * gate.gate.truncation**2 < wrong - right < 1.1 * gate.gate.truncation**2


def test_a_frame_is_tested_by_the_tracks_that_reach_farthest_to_both_sides(monkeypatch: pytest.MonkeyPatch) -> None:
    module, tested = "asfm.backend.ambiguity.partial_mirroring", list[IntArray]()

    def cost(_: Tracks, chosen: IntArray, *__: object) -> float:
        tested.append(chosen)
        return 1.0

    tracks, sequence, sensors, truth = make_case()
    monkeypatch.setattr(f"{module}.MAX_TRACKS", 6)
    monkeypatch.setattr(f"{module}._triangulation_cost", cost)
    frames, _ = scan_mirror_frames(
        tracks, truth, sequence, make_residual_gate(tracks, sequence, sensors, load_config())
    )
    first, last = tracks.frame_span()
    for frame, chosen in zip(frames.tolist(), tested[::2], strict=True):
        reach = np.minimum(frame + 1 - first, last - frame)
        assert reach[chosen].min() >= np.sort(reach)[-6] and reach[chosen].min() > 0 and len(chosen) == 6
