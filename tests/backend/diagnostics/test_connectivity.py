"""Connectivity: runs of steps that too few landmarks span are found and reported."""

from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from asfm.backend.diagnostics.connectivity import MIN_LINKS, connected_steps, warn_of_disconnected_steps
from asfm.backend.estimation.solution import Solution
from asfm.backend.graph.bundle_adjustment import Bundle
from asfm.backend.graph.problem import BundleProblem
from asfm.config import BackendConfig, Config
from asfm.diagnostics import Diagnostic
from asfm.geometry.sonar import SonarModel
from asfm.sequence import Sequence
from asfm.types import BoolArray, Tracks, Trajectory
from tests.worlds import no_frame

SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.7, 0.7), (500, 128), np.deg2rad(20))
NO_BUNDLE = cast(Bundle, None)
NO_PROBLEM = cast(BundleProblem, None)
"""Connectivity follows from the tracks alone."""


def _sequence(frame_count: int, odometry: bool = True) -> Sequence:
    stamps = np.arange(frame_count, dtype=np.float64)
    poses = np.repeat(np.eye(4)[None], frame_count, axis=0)
    return Sequence("made up", SONAR, stamps, no_frame, odometry=Trajectory(stamps, poses) if odometry else None)


def _solution(spans: list[list[int]], observed: BoolArray | None = None) -> Solution:
    """One track for each list of frames."""
    track = np.repeat(np.arange(len(spans)), [len(span) for span in spans])
    frame = np.array([index for span in spans for index in span], dtype=np.int64)
    tracks = Tracks(track, frame, np.ones(len(track)), np.zeros(len(track)))
    return Solution(
        tracks,
        np.ones(len(track), dtype=bool) if observed is None else observed,
        NO_BUNDLE,
        NO_PROBLEM,
        np.ones(len(track)),
    )


def _diagnose(spans: list[list[int]], frame_count: int, odometry: bool = True) -> tuple[Diagnostic, ...]:
    return warn_of_disconnected_steps(_sequence(frame_count, odometry), _solution(spans), Config())


def test_no_diagnostic_where_all_frames_share_landmarks() -> None:
    assert _diagnose([[0, 3, 7], [0, 7], [0, 1, 7]], 8) == ()


def test_gaps_are_reported_with_the_frames_around_them() -> None:
    (found,) = _diagnose([[0, 1, 2, 3]] * 3 + [[5, 6]] * 3 + [[6, 8, 9]] * 4, 11)
    assert found.code == "unsupported-steps" and found.frames == ((3, 5), (9, 10))
    assert found.message.startswith("3 of 10 steps")
    assert found.message.endswith("held by odometry between frames 3-5, 9-10")


def test_a_landmark_that_skips_frames_connects_them() -> None:
    assert connected_steps(_solution([[0, 4]] * 3), 5).tolist() == [True] * 4
    assert connected_steps(_solution([[0, 4]] * (MIN_LINKS - 1)), 5).tolist() == [False] * 4


def test_connected_steps_agree_with_a_direct_count() -> None:
    rng = np.random.default_rng(0)
    spans = [sorted(rng.choice(12, rng.integers(1, 5), replace=False).tolist()) for _ in range(12)]
    expected = [sum(min(s) <= step < max(s) for s in spans) >= MIN_LINKS for step in range(11)]
    assert len(set(expected)) == 2
    assert connected_steps(_solution(spans), 12).tolist() == expected


def test_rejected_observations_connect_nothing() -> None:
    spans = [[0, 1, 2]] * 3
    dropped = _solution(spans, np.array([True, True, False] * 3))
    assert connected_steps(dropped, 3).tolist() == [True, False]
    assert connected_steps(_solution(spans, np.zeros(9, dtype=bool)), 3).tolist() == [False, False]


@pytest.mark.parametrize("spans", [[], [[0, 1, 2, 3]] * 2])
@pytest.mark.parametrize("odometry", [True, False])
def test_without_any_connection_the_substitute_is_named(spans: list[list[int]], odometry: bool) -> None:
    (found,) = _diagnose(spans, 4, odometry)
    assert found.code == "unsupported-steps" and found.frames == ((0, 3),)
    assert "all 4 poses" in found.message
    assert found.message.endswith("held by odometry" if odometry else "held by the last pose")


def test_odometry_that_is_switched_off_is_no_substitute() -> None:
    config = Config(backend=BackendConfig(use_odometry=False))
    (found,) = warn_of_disconnected_steps(_sequence(4), _solution([]), config)
    assert found.code == "unsupported-steps" and found.message.endswith("held by the last pose")


def test_one_frame_is_reported() -> None:
    assert [found.code for found in _diagnose([], 1)] == ["single-frame"]


def test_many_runs_are_counted_beyond_the_first() -> None:
    spans = [[index, index + 1] for index in range(0, 40, 2) for _ in range(3)]
    (found,) = _diagnose(spans, 40)
    assert found.code == "unsupported-steps" and len(found.frames) == 19
    assert found.message.startswith("19 of 39 steps")
    assert found.message.endswith("15-16, and 11 more runs")


def test_time_stamps_do_not_change_the_diagnostics() -> None:
    sequence = _sequence(6)
    later = replace(sequence, timestamps_s=sequence.timestamps_s * 7 + 1e9)
    solution = _solution([[0, 1, 2]] * 3)
    assert warn_of_disconnected_steps(sequence, solution, Config()) == warn_of_disconnected_steps(
        later, solution, Config()
    )
