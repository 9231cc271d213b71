"""Loop closure stage: contradicted loops are rejected, consistent poses stay, matches become observations."""

from dataclasses import replace

import numpy as np
import pytest

from asfm.config import BackendConfig, Config, LoopsConfig
from asfm.frontend.loops.keypoint_tracks import KeypointTracks
from asfm.pipeline import loop_closure as loops
from asfm.pipeline.reconstruction import reconstruct
from asfm.sequence import Sequence
from asfm.simulation.simulate import simulate
from asfm.types import FloatArray, Keypoints, Matches
from tests.backend.loops.round_trip import SONAR, RoundTrip, make_round_trip


@pytest.fixture(scope="module")
def tank() -> Sequence:
    sequence = simulate("tank", frame_count=12, seed=1).sequence
    return replace(sequence, read_frame=list(sequence).__getitem__)


def test_without_loops_the_result_is_byte_identical(tank: Sequence) -> None:
    """Twelve frames of one view share their landmarks: no pair is checked, and no image is read again."""
    config = Config(backend=BackendConfig(rounds=2))
    with_loops = reconstruct(tank, config)
    without = reconstruct(tank, config.model_copy(update={"loops": LoopsConfig(enabled=False)}))
    poses = [run.reconstruction.trajectory.world_from_vehicle.tobytes() for run in (with_loops, without)]
    assert poses[0] == poses[1]
    (stage,) = (stage for stage in with_loops.stages if stage.name == "loops")
    assert stage.counts["pairs looked at"] == stage.counts["loops"] == 0
    assert "loops" not in [stage.name for stage in without.stages]


@pytest.mark.parametrize(("standing", "kept"), [(10, 10), (9, 9), (7, 0)])
def test_contradicted_loops_are_rejected_and_all_where_they_are_many(
    standing: int, kept: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A single contradicted loop is rejected alone; where many are contradicted all are, and the poses stay."""
    trip = make_round_trip(0)
    index = np.zeros((1, 2), dtype=np.int64)
    some = [Matches(number, number + 15, index, np.zeros(1)) for number in range(10)]
    keypoints = [_keypoint_of(trip, frame) for frame in range(30)]
    tracked = KeypointTracks(
        trip.solution.tracks, keypoints, SONAR, Config().noise, np.ones(len(trip.solution.tracks), dtype=bool)
    )
    monkeypatch.setattr(loops, "close_loops", lambda bundle, *_: bundle.world_from_vehicle + 1e-3)
    before = trip.solution.bundle.world_from_vehicle

    def stand(match: Matches, *rest: FloatArray) -> float:
        return float(match.frame_a < standing and not np.array_equal(rest[2], before))

    monkeypatch.setattr(loops, "arc_inlier_ratio", stand)
    frames = loops._LoopFrames(trip.sequence, keypoints, {}, Config())
    poses, left = loops._close_consistent(some, frames, trip.solution, tracked)
    assert [match.frame_a for match in left] == list(range(kept))
    assert np.array_equal(poses, before) == (kept == 0)


def test_poses_that_agree_with_all_loops_are_not_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    trip = make_round_trip(0)
    keypoints = [_keypoint_of(trip, frame) for frame in range(30)]
    everything = np.ones(len(trip.solution.tracks), dtype=bool)
    tracked = KeypointTracks(trip.solution.tracks, keypoints, SONAR, Config().noise, everything)
    monkeypatch.setattr(loops, "arc_inlier_ratio", lambda *_: 1.0)
    some = [Matches(1, 25, np.zeros((1, 2), dtype=np.int64), np.zeros(1))]
    poses, left = loops._close_consistent(
        some, loops._LoopFrames(trip.sequence, keypoints, {}, Config()), trip.solution, tracked
    )
    assert left == some and poses is trip.solution.bundle.world_from_vehicle


def _keypoint_of(trip: RoundTrip, frame: int) -> Keypoints:
    """Return the keypoints that are the observations of a frame."""
    tracks = trip.solution.tracks
    seen = tracks.frame == frame
    count = int(seen.sum())
    return Keypoints(
        np.zeros((count, 2)),
        tracks.range_m[seen],
        tracks.bearing_rad[seen],
        np.ones(count),
        np.zeros((count, 61), dtype=np.uint8),
        np.zeros((0, 29, 29), dtype=np.float32),
    )


def test_loop_observations_are_of_the_other_frame_s_landmarks() -> None:
    """A match of two tracks gives an observation of each track by the other's frame; one within a track gives none."""
    trip = make_round_trip(0)
    keypoints = [_keypoint_of(trip, frame) for frame in range(30)]
    tracks = trip.solution.tracks
    tracked = KeypointTracks(tracks, keypoints, SONAR, Config().noise, np.ones(len(tracks), dtype=bool))
    first, last = (tracks.track[tracks.frame == frame] for frame in (0, 29))
    np.testing.assert_array_equal(tracked.find(29, np.arange(len(last))), last)
    match = Matches(0, 29, np.array([[0, 0]]), np.zeros(1))
    again = loops.loop_observations([match, match], tracked)
    assert sorted(zip(again.track.tolist(), again.frame.tolist(), strict=True)) == sorted(
        [(int(first[0]), 29), (int(last[0]), 0)]
    )
    same = np.argwhere(tracks.track[tracks.frame == 0][:, None] == tracks.track[tracks.frame == 1])[:1]
    assert len(loops.loop_observations([Matches(0, 1, same, np.zeros(1))], tracked)) == 0
