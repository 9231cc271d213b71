"""Loops from proposal to closure, on a made-up round trip and on small simulated sequences."""

from dataclasses import dataclass, replace
from functools import lru_cache

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.backend.estimation.solution import Solution
from asfm.backend.graph.bundle_adjustment import Bundle
from asfm.backend.graph.factors import bearing_factor, range_factor, step_factor
from asfm.backend.graph.problem import FIRST_POINT, FIRST_POSE, BundleProblem
from asfm.backend.loops.loop_candidates import LoopPair, LoopSearch, choose_pairs, find_neighbours, search_loops
from asfm.backend.loops.loop_closure import close_loops
from asfm.config import BackendConfig, Config, LoopsConfig
from asfm.frontend.loops.keypoint_tracks import KeypointTracks
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import SonarModel, project
from asfm.navigation.sensor_constraints import SensorConstraints
from asfm.pipeline import loop_closure as loops
from asfm.pipeline.reconstruction import reconstruct
from asfm.sequence import Sequence
from asfm.simulation.simulate import simulate
from asfm.types import FloatArray, Keypoints, Matches, SensorNoise, Tracks
from tests.worlds import no_frame, number_keypoints

SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.6, 0.6), (600, 256), np.deg2rad(20))
SIGMA = np.array([0.02, 0.005])
STEP_SIGMA = (0.01, 0.04)
WINDOW = 8


@dataclass(frozen=True)
class RoundTrip:
    """Out and back along a wall, tracks that live for a few frames, and odometry that drifts."""

    truth: FloatArray
    solution: Solution
    sequence: Sequence
    again: Tracks
    """What the way back sees of the tracks of the way out."""


@lru_cache(maxsize=4)
def make_round_trip(seed: int, count: int = 30) -> RoundTrip:
    """Make the optimum of odometry and tracks."""
    rng = np.random.default_rng(seed)
    place_m = 6 * np.sin(np.linspace(0, np.pi, count))
    swing = 0.05 * rng.standard_normal((count, 6))
    swing[:, 1] += place_m
    truth = make_pose(swing[:, :3], Rotation.from_euler("ZYX", swing[:, 3:]))
    slip = rng.normal(0, np.repeat(STEP_SIGMA, 3), (count - 1, 6))
    steps = invert(truth[:-1]) @ truth[1:] @ make_pose(slip[:, 3:], Rotation.from_rotvec(slip[:, :3]))
    start = [truth[0]]
    for step in steps:
        start.append(start[-1] @ step)
    xyz_m = rng.uniform([3, -4, -0.4], [8, 10, 0.4], (110, 3))
    seen = transform(invert(truth)[:, None], xyz_m)
    frame, point = np.nonzero(SONAR.sees(seen))
    half = np.where(frame < count // 2, 0, 1)  # the way back begins tracks of its own
    key, track = np.unique(2 * point + half, return_inverse=True)
    order = np.lexsort((frame, track))
    frame, point, track = frame[order], point[order], track[order]
    range_m, bearing_rad, _ = project(seen[frame, point])
    noise = rng.normal(0, SIGMA, (len(frame), 2))
    tracks = number_keypoints(Tracks(track, frame, range_m + noise[:, 0], bearing_rad + noise[:, 1]))
    bundle = _adjust(tracks, np.stack(start), steps, xyz_m[key // 2])
    partner = np.searchsorted(key, 2 * point)  # the way out's track of the same point
    back = (frame >= count - 5) & np.isin(2 * point, key)
    again = Tracks(partner[back], frame[back], tracks.range_m[back], tracks.bearing_rad[back])
    stated = SensorNoise(odometry_rotation_rad=STEP_SIGMA[0], odometry_translation_m=STEP_SIGMA[1])
    sequence = Sequence("round trip", SONAR, np.arange(count, dtype=float), no_frame, noise=stated)
    return RoundTrip(
        truth,
        Solution(tracks, np.ones(len(track), dtype=bool), bundle, _pose_problem(tracks, steps), np.ones(tracks.count)),
        sequence,
        again,
    )


def _pose_problem(tracks: Tracks, steps: FloatArray) -> BundleProblem:
    """Say what the round trip was optimised from: steps that odometry measured."""
    nothing = np.zeros((0, 3))
    step_sigma = np.tile(STEP_SIGMA, (len(steps), 1))
    sensors = SensorConstraints(np.eye(4), np.eye(6), True, steps, step_sigma, nothing, nothing)
    used, sigma = np.ones(len(tracks), dtype=bool), np.tile(SIGMA, (len(tracks), 1))
    return BundleProblem(tracks, used, sigma, sensors, np.eye(4), SONAR.elevation_aperture_rad / 2)


def _adjust(tracks: Tracks, start: FloatArray, steps: FloatArray, xyz_m: FloatArray) -> Bundle:
    graph, values, lever_arm = gtsam.NonlinearFactorGraph(), gtsam.Values(), gtsam.Pose3()
    graph.add(gtsam.PriorFactorPose3(FIRST_POSE, gtsam.Pose3(start[0]), gtsam.noiseModel.Isotropic.Sigma(6, 1e-4)))
    for index, step in enumerate(steps):
        graph.add(step_factor(FIRST_POSE + index, FIRST_POSE + index + 1, step, *STEP_SIGMA))
    for index, pose in enumerate(start):
        values.insert(FIRST_POSE + index, gtsam.Pose3(pose))
    for index, point in enumerate(xyz_m):
        values.insert(FIRST_POINT + index, point)
        prior = gtsam.noiseModel.Isotropic.Sigma(3, 2.0)
        graph.add(gtsam.PriorFactorPoint3(FIRST_POINT + index, point + 0.1, prior))
    for track, frame, range_m, bearing_rad in zip(
        tracks.track.tolist(), tracks.frame.tolist(), tracks.range_m.tolist(), tracks.bearing_rad.tolist(), strict=True
    ):
        keys = FIRST_POSE + frame, FIRST_POINT + track
        graph.add(range_factor(*keys, range_m, SIGMA[0], lever_arm))
        graph.add(bearing_factor(*keys, bearing_rad, SIGMA[1], lever_arm))
    values = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    poses = np.stack([values.atPose3(FIRST_POSE + index).matrix() for index in range(len(start))])
    points = np.stack([values.atPoint3(FIRST_POINT + index) for index in range(len(xyz_m))])
    return Bundle(poses, points, np.ones(len(xyz_m), dtype=bool), graph, graph, values)


def _error_m(poses: FloatArray, truth: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.sum((poses - truth)[:, :2, 3] ** 2, axis=1))))


def test_closing_a_loop_takes_the_drift_away() -> None:
    """Over three round trips the end comes back to where the way out saw its points, in the plane.

    The height hangs on elevations, which hardly show in this motion: a loop does not tell it.
    """
    at_end: list[list[float]] = []
    all_over: list[list[float]] = []
    for seed in range(3):
        trip = make_round_trip(seed)
        before = trip.solution.bundle.world_from_vehicle
        after = close_loops(trip.solution.bundle, trip.again, SIGMA, np.eye(4), 0.0)
        for errors, part in ((at_end, slice(-5, None)), (all_over, slice(None))):
            errors.append([_error_m(poses[part], trip.truth[part]) for poses in (before, after)])
    assert np.divide(*np.mean(at_end, axis=0)) > 2.0
    assert np.divide(*np.mean(all_over, axis=0)) > 1.4


def test_nothing_seen_again_moves_nothing() -> None:
    trip = make_round_trip(0)
    nothing = Tracks(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0), np.zeros(0))
    after = close_loops(trip.solution.bundle, nothing, SIGMA, np.eye(4), 0.0)
    assert after is trip.solution.bundle.world_from_vehicle


def test_the_search_finds_the_way_back() -> None:
    """Pairs of the way out and the way back that are at the same place, and none within the window."""
    trip = make_round_trip(1)
    search = search_loops(trip.solution, trip.sequence, LoopsConfig(), WINDOW)
    assert search.pairs
    place_m = trip.truth[:, 1, 3]
    for pair in search.pairs.values():
        assert pair.frame_b - pair.frame_a > WINDOW
        assert 0 < pair.range_sigma_m < 1 and 0 < pair.bearing_sigma_rad < 0.5
        assert pair.overlap >= LoopsConfig().min_overlap
        assert abs(place_m[pair.frame_a] - place_m[pair.frame_b]) < 6
    best = max(search.pairs.values(), key=lambda pair: pair.overlap)
    assert best.frame_a < 15 <= best.frame_b


def _know_otherwise(solution: Solution, measured: bool, loose: dict[int, float]) -> Solution:
    """Give the same solution from other sensors; loose: by how much some steps' sigmas are wider than stated."""
    sensors = solution.problem.sensors
    step_sigma = sensors.step_sigma.copy()
    for step, factor in loose.items():
        step_sigma[step] *= factor
    sensors = replace(sensors, measured=measured, step_sigma=step_sigma)
    return replace(solution, problem=replace(solution.problem, sensors=sensors))


TURN = 14
"""The step of a round trip that no track bridges."""


@pytest.mark.parametrize(
    ("measured", "loose", "crosses"),
    [
        (True, {}, True),
        (True, {TURN: 1.9}, True),
        (True, {TURN: 5.0}, False),
        (True, dict.fromkeys(range(TURN), 5.0), True),
        (False, {}, False),
    ],
)
def test_no_pair_reaches_across_a_step_that_nothing_knows(
    measured: bool, loose: dict[int, float], crosses: bool
) -> None:
    """Odometry knows every step unless it is unreliable, and tracks every one but the turn."""
    trip = make_round_trip(1)
    search = search_loops(_know_otherwise(trip.solution, measured, loose), trip.sequence, LoopsConfig(), WINDOW)
    assert any(a <= TURN < b for a, b in search.pairs) == crosses
    if crosses:
        assert search.pairs == search_loops(trip.solution, trip.sequence, LoopsConfig(), WINDOW).pairs


@pytest.mark.parametrize(("bridges", "crosses"), [(5, False), (6, True)])
def test_a_chain_rests_on_as_many_landmarks_as_a_loop(bridges: int, crosses: bool) -> None:
    """Without odometry, so many landmarks of the way out are seen once more after the turn."""
    trip = make_round_trip(1)
    solution = _know_otherwise(trip.solution, False, {})
    tracks = solution.tracks
    chosen = np.unique(tracks.track[tracks.frame == TURN])[:bridges]
    table = np.stack([tracks.track, tracks.frame], axis=1)
    more = np.stack([chosen, np.full(len(chosen), TURN + 1)], axis=1)
    track, frame = np.concatenate([table, more]).T
    order = np.lexsort((frame, track))
    range_m, bearing_rad = (np.append(part, part[: len(chosen)]) for part in (tracks.range_m, tracks.bearing_rad))
    longer = Tracks(track[order], frame[order], range_m[order], bearing_rad[order])
    solution = replace(solution, tracks=longer, observed=np.ones(len(longer), dtype=bool))
    search = search_loops(solution, trip.sequence, LoopsConfig(), WINDOW)
    assert len(chosen) == bridges
    assert any(a <= TURN < b for a, b in search.pairs) == crosses


def test_frames_that_share_landmarks_need_no_loop() -> None:
    trip = make_round_trip(1)
    everything = LoopsConfig(max_shared=0)
    few, many = (
        search_loops(trip.solution, trip.sequence, settings, WINDOW) for settings in (everything, LoopsConfig())
    )
    assert set(few.pairs) <= set(many.pairs)
    used = trip.solution.tracks
    for a, b in few.pairs:
        assert not np.intersect1d(used.track[used.frame == a], used.track[used.frame == b]).size


def _search_of(pairs: list[tuple[int, int, float]], count: int) -> LoopSearch:
    return LoopSearch(np.arange(count), {(a, b): LoopPair(a, b, share, 0.1, 0.01) for a, b, share in pairs})


@pytest.mark.parametrize("most", [1, 30, 1000])
def test_choice_is_bounded_and_spread(most: int) -> None:
    """The best pair of each cell, and the cells as small as the bound allows."""
    rng = np.random.default_rng(0)
    search = _search_of([(a, b, rng.random()) for a in range(50) for b in range(60, 110)], 110)
    chosen = choose_pairs(search, LoopsConfig(max_pairs=most), WINDOW)
    assert len(chosen) <= most
    assert len(chosen) >= (150 if most == 1000 else most / 2)
    assert max(pair.overlap for pair in search.pairs.values()) in [pair.overlap for pair in chosen]
    assert len({(pair.frame_a, pair.frame_b) for pair in chosen}) == len(chosen)
    if most == 30:
        for frames in ([pair.frame_a for pair in chosen], [pair.frame_b - 60 for pair in chosen]):
            assert min(frames) < 15 and max(frames) > 35
    assert chosen == choose_pairs(search, LoopsConfig(max_pairs=most), WINDOW)


def test_neighbours_come_just_before_and_after() -> None:
    search = _search_of([(4, 30, 0.9), (3, 29, 0.5), (5, 31, 0.5), (6, 32, 0.5)], 40)
    found = find_neighbours(search, search.pairs[4, 30])
    assert {(pair.frame_a, pair.frame_b) for pair in found} == {(3, 29), (5, 31)}


@pytest.fixture(scope="module")
def tank() -> Sequence:
    sequence = simulate("tank", frame_count=12, seed=1).sequence
    return replace(sequence, read_frame=list(sequence).__getitem__)


def test_without_a_loop_nothing_changes(tank: Sequence) -> None:
    """Twelve frames of one view share their landmarks: the same bytes, and no image is read again."""
    config = Config(backend=BackendConfig(rounds=2))
    with_loops = reconstruct(tank, config)
    without = reconstruct(tank, config.model_copy(update={"loops": LoopsConfig(enabled=False)}))
    poses = [run.reconstruction.trajectory.world_from_vehicle.tobytes() for run in (with_loops, without)]
    assert poses[0] == poses[1]
    (stage,) = (stage for stage in with_loops.stages if stage.name == "loops")
    assert stage.counts["pairs looked at"] == stage.counts["loops"] == 0
    assert stage.wall_s < 1.0
    assert "loops" not in [stage.name for stage in without.stages]


@pytest.mark.parametrize(("standing", "kept"), [(10, 10), (9, 9), (7, 0)])
def test_loops_that_contradict_each_other_are_all_left_out(
    standing: int, kept: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that the others outvote goes alone; where many disagree nobody tells who is right, and nothing moves."""
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
    eyes = loops._LoopFrames(trip.sequence, keypoints, {}, Config())
    poses, left = loops._close_consistent(some, eyes, trip.solution, tracked)
    assert [match.frame_a for match in left] == list(range(kept))
    assert np.array_equal(poses, before) == (kept == 0)


def test_loops_that_the_poses_agree_with_leave_them_alone(monkeypatch: pytest.MonkeyPatch) -> None:
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
    """Give the keypoints behind the observations of a frame."""
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


def test_sightings_are_of_the_other_sides_landmarks() -> None:
    """A match of two tracks tells each side's frame of the other side's landmark; one of a single track, nothing."""
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
