"""The rounds of association and adjustment on a small simulated sequence: they end when little changes."""

import numpy as np
import pytest

from asfm.backend.estimation.solution import Solution
from asfm.config import Config
from asfm.config_file import load_config
from asfm.frontend.tracking.triangulated_tracks import TriangulatedTracks
from asfm.navigation.frame_navigation import read_navigation
from asfm.navigation.pose_prediction import predict_poses
from asfm.pipeline.feature_matching import extract_matches
from asfm.pipeline.reconstruction import initialise, optimise, reconstruct
from asfm.recorder import NullRecorder
from asfm.sequence import Sequence
from asfm.simulation.simulate import simulate
from asfm.stages import StageClock
from asfm.types import ExternalMatches, Keypoints, Matches

FRAMES = 8


def extract(sequence: Sequence) -> tuple[list[Keypoints], list[Matches]]:
    prediction = predict_poses(read_navigation(sequence, Config().backend), sequence)
    return extract_matches(sequence, Config(), NullRecorder(), StageClock(), prediction)


@pytest.fixture(scope="module")
def extracted() -> tuple[Sequence, list[Keypoints], list[Matches]]:
    sequence = simulate("tank", frame_count=FRAMES, seed=1).sequence
    return sequence, *extract(sequence)


def run_rounds(
    extracted: tuple[Sequence, list[Keypoints], list[Matches]], *settings: str
) -> tuple[Solution, list[str]]:
    sequence, keypoints, candidates = extracted
    config, clock = load_config(None, settings), StageClock()
    navigation = read_navigation(sequence, config.backend)
    start = initialise(sequence, navigation, keypoints, candidates, config, clock)
    solution = optimise(sequence, keypoints, candidates, start, config, clock)
    return solution, [report.name for report in clock.reports if report.name.startswith("round")]


@pytest.mark.parametrize(("share", "rounds"), [(1.0, 2), (0.0, 4)])
def test_rounds_end_when_little_changes(
    extracted: tuple[Sequence, list[Keypoints], list[Matches]], share: float, rounds: int
) -> None:
    _, names = run_rounds(extracted, f"tracks.settled_share={share}", "backend.rounds=4")
    assert names == [f"round {number + 1}" for number in range(rounds)]


def test_tracks_grow_from_round_to_round(extracted: tuple[Sequence, list[Keypoints], list[Matches]]) -> None:
    every = ("backend.rounds=3", "tracks.settled_share=0")
    grown, _ = run_rounds(extracted, *every)
    plain, _ = run_rounds(extracted, *every, "tracks.window=0")
    assert len(grown.tracks) / grown.tracks.count > len(plain.tracks) / plain.tracks.count
    assert grown.observed.sum() >= plain.observed.sum()
    for solution in (grown, plain):
        seen = np.stack([solution.tracks.track, solution.tracks.frame], axis=1)
        assert len(np.unique(seen, axis=0)) == len(seen), "no track has two observations in a frame"


def test_one_round_is_one_round(extracted: tuple[Sequence, list[Keypoints], list[Matches]]) -> None:
    assert run_rounds(extracted, "backend.rounds=1")[1] == ["round 1"]


def test_given_matches_stay_alone(
    extracted: tuple[Sequence, list[Keypoints], list[Matches]], monkeypatch: pytest.MonkeyPatch
) -> None:
    sequence, keypoints, candidates = extracted
    windows: list[int] = []

    def remember(solved: TriangulatedTracks, window: int) -> list[Matches]:
        windows.append(window)
        return []

    monkeypatch.setattr("asfm.pipeline.reconstruction.match_to_landmarks", remember)
    given = ExternalMatches(tuple(frame.without_patches() for frame in keypoints), tuple(candidates))
    reconstruct(sequence, load_config(None, ("backend.rounds=2",)), external=given)
    assert windows == []
