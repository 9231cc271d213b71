"""Partially mirrored solutions are detected and corrected; others are returned unchanged."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from asfm.backend.ambiguity.mirror_search import OtherOptimum
from asfm.backend.ambiguity.partial_mirroring import MIN_EVIDENCE, MIN_GAIN, compare_fits, correct_partial_mirroring
from asfm.backend.estimation.residual_gate import GUESSED_SLACK, make_residual_gate
from asfm.backend.estimation.solution import solve_tracks
from asfm.backend.estimation.triangulation import triangulate_tracks
from asfm.config_file import load_config
from asfm.geometry.reflection import reflect_after
from asfm.navigation.sensor_constraints import SensorConstraints
from asfm.sequence import Sequence
from asfm.types import FloatArray, Tracks
from tests.oscillating_roll import FLIP, FRAMES, LEVER_ARM, SONAR, make_case, roll_rad


def test_a_partially_mirrored_solution_is_corrected() -> None:
    tracks, sequence, sensors, truth = make_case()
    config = load_config()
    mirrored = solve_tracks(tracks, sequence, reflect_after(truth, FLIP, LEVER_ARM), sensors, config)
    corrected = correct_partial_mirroring(mirrored, sequence, config)
    images = [roll_rad(truth), roll_rad(reflect_after(truth, 0, LEVER_ARM))]
    before, after = (
        min(np.abs(roll_rad(solution.bundle.world_from_vehicle) - image).max() for image in images)
        for solution in (mirrored, corrected)
    )
    assert before > 0.3 > 0.1 > after, "the optimisation alone does not leave the local optimum"
    residual_gate = make_residual_gate(tracks, sequence, sensors, config)
    assert compare_fits(mirrored, corrected, sequence, residual_gate, 1.0) > MIN_EVIDENCE / 2
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


GAIN = MIN_EVIDENCE / 2


@pytest.mark.parametrize(
    ("gain", "log_odds", "attitude", "taken"),
    [
        (GAIN, GAIN - 0.1, False, False),
        (GAIN, GAIN + 0.1, False, True),
        (2 * MIN_EVIDENCE, -0.1, False, False),
        (MIN_GAIN - 0.1, 2 * MIN_EVIDENCE, False, False),
        (GAIN, GAIN + 0.1, True, False),
    ],
)
def test_another_solution_needs_strong_evidence_from_both_adjustments_and_no_attitude(
    monkeypatch: pytest.MonkeyPatch, gain: float, log_odds: float, attitude: bool, taken: bool
) -> None:
    """A candidate is found in the first solution; the adjustment from its poses gives the other one."""
    module = "asfm.backend.ambiguity.partial_mirroring"
    tracks, sequence, sensors, truth = make_case()
    problem = SimpleNamespace(sensors=with_attitude(sensors) if attitude else sensors)
    solutions: list[Any] = [
        SimpleNamespace(
            tracks=tracks,
            bundle=SimpleNamespace(world_from_vehicle=poses),
            problem=problem,
            observed=np.ones(3, dtype=bool),
        )
        for poses in (truth, reflect_after(truth, FLIP, LEVER_ARM))
    ]
    given, other = solutions
    candidate = OtherOptimum(FLIP, other.bundle.world_from_vehicle @ LEVER_ARM, gain)
    monkeypatch.setattr(f"{module}.search_other_optima", lambda of: [candidate] if of is given else [])

    def solve(_: Tracks, __: Sequence, poses: FloatArray, *___: object) -> Any:
        return min(solutions, key=lambda solution: float(np.abs(solution.bundle.world_from_vehicle - poses).max()))

    monkeypatch.setattr(f"{module}.solve_tracks", solve)
    monkeypatch.setattr(f"{module}.compare_fits", lambda first, second, *_: log_odds if second is other else np.nan)
    assert correct_partial_mirroring(given, sequence, load_config()) is (other if taken else given)


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
