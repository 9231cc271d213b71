"""Wiring of the loop closure stage: which pairs are matched, verified, confirmed by others, and closed."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from asfm.backend.loops.loop_candidates import LoopPair, LoopSearch
from asfm.config import Config
from asfm.frontend.loops.loop_check import LoopCheck
from asfm.geometry.feature_noise import difference_sigma, feature_sigma
from asfm.pipeline import loop_closure
from asfm.sequence import Sequence
from asfm.stages import StageReport
from asfm.types import Frame, Matches
from tests.pipeline.stubs import Calls, stub_stages
from tests.worlds import VEHICLE_SONAR, make_keypoints, make_vehicle_path, make_vehicle_sequence

Stub = Callable[[str, Any], Calls]
CONFIG = Config.model_validate({"matching": {"max_gap": 5}, "loops": {"min_similarity": 0.4}})
KEYPOINTS: Any = [make_keypoints(np.full(1, 1.0 + number), np.zeros(1)).without_patches() for number in range(40)]


@dataclass(frozen=True)
class Trip:
    """A sequence of the vehicle's path, and a solution with a track that one of two observations uses."""

    sequence: Sequence
    solution: Any


@pytest.fixture(scope="module")
def trip() -> Trip:
    def read_frame(index: int) -> Frame:
        return Frame(index, float(index), np.zeros((2, 2), np.float32), np.zeros((2, 2), dtype=bool))

    bundle = SimpleNamespace(world_from_vehicle=make_vehicle_path())
    solution = SimpleNamespace(bundle=bundle, tracks="tracks", observed=np.array([True, False]))
    return Trip(replace(make_vehicle_sequence(), read_frame=read_frame), solution)


@pytest.fixture
def stub(monkeypatch: pytest.MonkeyPatch) -> Stub:
    return stub_stages(monkeypatch, "loop_closure")


def pair_of(frame_a: int, frame_b: int) -> LoopPair:
    return LoopPair(frame_a, frame_b, 1.0, 0.8, 0.08)


def matches_of(pair: LoopPair, cost: float = 0.3) -> Matches:
    return Matches(pair.frame_a, pair.frame_b, np.zeros((1, 2), dtype=np.int64), np.full(1, cost))


def check_of(pair: LoopPair, reason: str = "", sure: bool = True, shift_m: float = 0.0) -> LoopCheck:
    return LoopCheck(matches_of(pair), reason, np.array([shift_m, 0.0]), 0.1, sure)


def frames_of(trip: Trip) -> loop_closure._LoopFrames:
    return loop_closure._LoopFrames(trip.sequence, list(KEYPOINTS), {}, CONFIG)


def test_the_sigma_of_a_step_is_that_of_the_pair_over_the_root_of_its_gap(stub: Stub, trip: Trip) -> None:
    """The errors of the steps add up as a random walk: over the gap they are the pair's sigmas again."""
    pair = pair_of(3, 28)
    matched, tracked = stub("match_pairs", [matches_of(pair)]), object()
    stub("align_matches", ["aligned"])
    verified = stub("verify_loop", "checked")
    poses = make_vehicle_path()
    found: Any = loop_closure._check_pair(pair, frames_of(trip), poses, tracked)  # type: ignore[arg-type]
    (pairs, _, _, sonar, predicted) = matched[0]
    assert found == "checked" and pairs == [(3, 28)] and sonar is VEHICLE_SONAR
    assert predicted.step_rotation_rad == pytest.approx(0.08 / 5) and predicted.step_translation_m == pytest.approx(
        0.16
    )
    np.testing.assert_array_equal(predicted.world_from_sonar, poses)
    assert verified[0][0] == "aligned" and verified[0][3] is predicted and verified[0][4] is tracked


def test_only_similar_places_are_matched_with_patches_cut_once(stub: Stub, trip: Trip) -> None:
    described = stub("describe_place", lambda frame, _: frame.index)
    stub("place_similarity", lambda a, b: 0.4 if b == 20 else 0.39)
    cut = stub("cut_keypoint_patches", lambda frame, keypoints, *_: f"patches of {frame.index}")
    checked_pairs = stub("_check_pair", "check")
    frames, tracked = frames_of(trip), object()
    pairs = [pair_of(1, 20), pair_of(1, 21), pair_of(2, 20)]
    poses = make_vehicle_path()
    checked: Any = loop_closure._check_pairs(pairs, frames, poses, tracked)  # type: ignore[arg-type]
    assert checked == [(pairs[0], "check"), (pairs[2], "check")] and len(checked_pairs) == 2
    assert sorted(call[0].index for call in described) == sorted(call[0].index for call in cut) == [1, 2, 20, 21]
    assert all(call[1] is KEYPOINTS[call[0].index] for call in cut)
    assert frames.keypoints[20] == "patches of 20" and frames.keypoints[3] is KEYPOINTS[3]  # type: ignore[comparison-overlap]


def test_a_loop_counts_only_with_another_one_near_that_agrees(trip: Trip) -> None:
    """Two windows apart still support each other; what stands alone, disagrees or failed a test does not count."""
    near, far = [pair_of(2, 22), pair_of(2 + 10, 22 + 10)], pair_of(2 + 21, 22 + 17)
    checks = [(pair, check_of(pair)) for pair in (*near, far)]
    assert [pair for pair, _ in loop_closure._confirmed_pairs(checks, 5)] == near
    for other in (check_of(near[1], shift_m=3.0), check_of(near[1], reason="chance")):
        assert not loop_closure._confirmed_pairs([checks[0], (near[1], other)], 5)
    assert not loop_closure._confirmed_pairs(checks[:1], 5)
    unsure = [(pair, check_of(pair, sure=False)) for pair in near]
    assert not loop_closure._confirmed_pairs(unsure, 5)
    assert len(loop_closure._confirmed_pairs([checks[0], unsure[1]], 5)) == 2


def test_neighbours_are_sought_for_sure_pairs_that_nothing_confirms() -> None:
    alone, confirmed, unsure = pair_of(20, 35), [pair_of(0, 15), pair_of(1, 16)], pair_of(8, 38)
    beside = [pair_of(19, 34), pair_of(21, 36)]
    others = [pair_of(7, 37), pair_of(2, 17)]
    everything = [alone, *confirmed, unsure, *beside, *others]
    search = LoopSearch(np.arange(40), {(pair.frame_a, pair.frame_b): pair for pair in everything})
    checked = [(pair, check_of(pair)) for pair in (alone, *confirmed)] + [(unsure, check_of(unsure, sure=False))]
    assert loop_closure._unconfirmed_neighbours(search, checked, 5) == beside
    again = [*checked, (beside[0], check_of(beside[0], reason="chance"))]
    assert loop_closure._unconfirmed_neighbours(search, again, 5) == beside[1:], "no pair is checked twice"


def test_stages_work_on_the_poses_of_the_sonar_and_loops_rank_after_the_window(
    monkeypatch: pytest.MonkeyPatch, stub: Stub, trip: Trip
) -> None:
    """A chosen pair is confirmed by a neighbour alone; the tracks are built from the window's matches before it."""
    pair, neighbour = pair_of(3, 28), pair_of(4, 29)
    searched = stub("search_loops", "search")
    stub("choose_pairs", [pair])
    stub("_unconfirmed_neighbours", [neighbour])
    checked = stub("_check_pairs", lambda pairs, *_: [(one, check_of(one)) for one in pairs])
    tracked = stub("KeypointTracks", "keypoint tracks")
    closed = stub("_close_consistent", lambda loops, *_: ("closed poses", loops))
    report = StageReport("loops")
    found: Any = loop_closure.find_loops(trip.sequence, KEYPOINTS, trip.solution, CONFIG, report)
    assert searched == [(trip.solution, trip.sequence, CONFIG.loops, 5)]
    assert [call[0] for call in checked] == [[pair], [neighbour]]
    for call in checked:
        np.testing.assert_array_equal(call[2], make_vehicle_path() @ trip.sequence.vehicle_from_sonar)
    assert tracked[0][:3] == ("tracks", KEYPOINTS, VEHICLE_SONAR) and tracked[0][4] is trip.solution.observed
    assert [match.frame_a for match in closed[0][0]] == [3, 4]
    assert found.world_from_vehicle == "closed poses"
    assert [match.cost.item() for match in found.matches] == pytest.approx([0.3 + loop_closure.LOOP_COST_OFFSET] * 2)
    assert loop_closure.LOOP_COST_OFFSET >= 1.0, "ratios, which other costs begin with, are at most 1"
    assert report.counts["pairs looked at"] == report.counts["loops"] == report.counts["matches"] == 2


def test_loops_are_closed_and_judged_with_the_noise_and_lever_arm_of_the_sonar(stub: Stub, trip: Trip) -> None:
    closed_poses = make_vehicle_path() + 1.0
    closing = stub("close_loops", closed_poses)
    stub("loop_observations", "observations")
    judged = stub("arc_inlier_ratio", loop_closure.MIN_INLIER_RATIO)
    tracked: Any = "keypoint tracks"
    loops = [matches_of(pair_of(3, 28))]
    poses, left = loop_closure._close_consistent(loops, frames_of(trip), trip.solution, tracked)
    assert left == loops and poses is trip.solution.bundle.world_from_vehicle
    bundle, observations, sigma, lever, correlation = closing[0]
    assert (bundle, observations, correlation) == (
        trip.solution.bundle,
        "observations",
        CONFIG.backend.track_correlation,
    )
    np.testing.assert_array_equal(sigma, feature_sigma(VEHICLE_SONAR, CONFIG.noise))
    np.testing.assert_array_equal(lever, trip.sequence.vehicle_from_sonar)
    for call, expected in zip(judged, (closed_poses, make_vehicle_path()), strict=True):
        np.testing.assert_array_equal(call[3], expected @ trip.sequence.vehicle_from_sonar)
        np.testing.assert_array_equal(call[4], difference_sigma(VEHICLE_SONAR, CONFIG.noise))
        assert call[5] == CONFIG.matching.arc_gate


def test_a_loop_that_stands_alone_is_not_closed(stub: Stub, trip: Trip) -> None:
    """It passed every test, and no neighbour is a candidate."""
    pair = pair_of(3, 28)
    stub("search_loops", LoopSearch(np.arange(40), {(3, 28): pair}))
    stub("choose_pairs", [pair])
    stub("_check_pairs", lambda pairs, *_: [(one, check_of(one)) for one in pairs])
    stub("KeypointTracks", "keypoint tracks")
    closed = stub("_close_consistent", lambda loops, *_: ("poses", loops))
    report = StageReport("loops")
    found: Any = loop_closure.find_loops(trip.sequence, KEYPOINTS, trip.solution, CONFIG, report)
    assert closed[0][0] == [] and found.matches == []
    assert report.counts["rejected for standing alone"] == 1


@pytest.mark.parametrize(("short", "kept"), [(0.0, 1), (0.01, 0)])
def test_half_of_the_matches_of_a_loop_must_agree_with_the_closed_poses(
    stub: Stub, trip: Trip, short: float, kept: int
) -> None:
    stub("close_loops", make_vehicle_path() + 1.0)
    stub("loop_observations", "observations")
    stub("arc_inlier_ratio", 0.5 - short)
    tracked: Any = "keypoint tracks"
    _, left = loop_closure._close_consistent([matches_of(pair_of(3, 28))], frames_of(trip), trip.solution, tracked)
    assert len(left) == kept
