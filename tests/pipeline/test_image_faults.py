"""Suspected odometry: matched again without it, images turned whose axis is reversed, nothing otherwise."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.backend.initialisation.initial_poses import InitialPoses, initialise_from_odometry
from asfm.config import BackendConfig, Config
from asfm.geometry.feature_noise import feature_sigma
from asfm.geometry.poses import depth_roll_pitch, make_pose
from asfm.navigation.frame_navigation import FrameNavigation, read_navigation
from asfm.navigation.odometry_hypotheses import AS_RECORDED, PointPairs
from asfm.pipeline.image_faults import (
    MatchedSequence,
    _attitude_fits,
    rematch_suspected,
    report_image_jumps,
    report_image_order,
    reverse_images,
)
from asfm.sequence import Sequence
from asfm.stages import StageClock
from asfm.types import Frame
from tests.pipeline.stubs import Calls, stub_stages
from tests.worlds import make_keypoints, make_vehicle_path, make_vehicle_sequence

Stub = Callable[[str, Any], Calls]
RECORDER: Any = "recorder"


def read_ramp(index: int) -> Frame:
    image = np.linspace(0, 1, 12, dtype=np.float32).reshape(4, 3)
    return Frame(index, 0.1 * index, image, image > 0.8)


@pytest.fixture
def stub(monkeypatch: pytest.MonkeyPatch) -> Stub:
    return stub_stages(monkeypatch, "image_faults")


@pytest.fixture
def sequence() -> Sequence:
    return replace(make_vehicle_sequence(), read_frame=read_ramp)


def suspicion(axis: str | None = None, suspicious: bool = True) -> Any:
    return SimpleNamespace(suspicious=suspicious, image_axis=axis, mounting=None)


def rematch(sequence: Sequence, stub: Stub, tests: list[Any]) -> tuple[MatchedSequence, Any, Calls]:
    """Run with prepared results of the tests; extracted matches are named by whether they saw turned images."""
    stub("collect_point_pairs", [])
    stub("compare_odometry_hypotheses", lambda *_: tests.pop(0))
    stub("diagnose_images", lambda *_: "images turned")
    extracted = stub(
        "extract_matches", lambda made, *_: (["keypoints"], ["turned" if made is not sequence else "ungated"])
    )
    given = MatchedSequence(sequence, [], [])
    navigation = read_navigation(sequence, BackendConfig())
    return given, rematch_suspected(given, navigation, Config(), RECORDER, StageClock()), extracted


@pytest.mark.parametrize("test", [None, suspicion(suspicious=False)])
def test_odometry_within_the_noise_costs_no_second_matching(sequence: Sequence, stub: Stub, test: Any) -> None:
    given, found, extracted = rematch(sequence, stub, [test])
    assert found is given and not extracted


@pytest.mark.parametrize("second", [None, suspicion(suspicious=False), suspicion()])
def test_suspected_odometry_does_not_gate_matches(sequence: Sequence, stub: Stub, second: Any) -> None:
    _, found, extracted = rematch(sequence, stub, [suspicion(), second])
    assert found.matches == ["ungated"] and found.sequence is sequence and found.diagnostics == ()
    assert len(extracted) == 1 and extracted[0][4:] == (None, None), "no prediction of poses"
    assert extracted[0][2] is not RECORDER, "the frames were shown before"


@pytest.mark.parametrize("axis", ["range", "bearing"])
def test_images_are_turned_and_shown_again(sequence: Sequence, stub: Stub, axis: str) -> None:
    _, found, extracted = rematch(sequence, stub, [suspicion(axis), suspicion(axis)])
    assert found.matches == ["turned"] and found.diagnostics == ("images turned",)
    assert extracted[1][0] is found.sequence and extracted[1][2] is RECORDER
    along = 0 if axis == "range" else 1
    np.testing.assert_array_equal(found.sequence.read_frame(3).image, np.flip(read_ramp(3).image, along))


@pytest.mark.parametrize("odometry_turned", [False, True])
def test_a_turned_mounting_is_corrected_unless_attitude_says_that_odometry_is_turned(
    sequence: Sequence, stub: Stub, odometry_turned: bool
) -> None:
    stub("diagnose_mounting", "mounting turned")
    poses = make_vehicle_path()
    turned = poses @ make_pose(np.zeros(3), Rotation.from_euler("z", np.pi / 2))
    as_recorded, likely = (turned, poses) if odometry_turned else (poses, turned)
    hypotheses = {
        AS_RECORDED: SimpleNamespace(world_from_vehicle=as_recorded),
        "fault": SimpleNamespace(world_from_vehicle=likely),
    }
    mounting, found_test = np.diag([-1.0, -1.0, 1.0, 1.0]), suspicion()
    found_test.mounting, found_test.hypotheses, found_test.likely_fault = mounting, hypotheses, "fault"
    _, found, _ = rematch(sequence, stub, [suspicion(), found_test])
    if odometry_turned:
        assert found.sequence is sequence and found.diagnostics == ()
    else:
        assert found.sequence.vehicle_from_sonar is mounting and found.diagnostics == ("mounting turned",)
    assert found.matches == ["ungated"]


@pytest.mark.parametrize(("axis", "along"), [("range", 0), ("bearing", 1)])
def test_image_and_mask_are_reversed_along_one_axis(sequence: Sequence, axis: Any, along: int) -> None:
    turned, frame = reverse_images(sequence, axis).read_frame(2), sequence.read_frame(2)
    np.testing.assert_array_equal(turned.image, np.flip(frame.image, along))
    np.testing.assert_array_equal(turned.invalid, np.flip(frame.invalid, along))
    assert turned.index == 2 and turned.timestamp_s == frame.timestamp_s
    assert turned.image.flags.c_contiguous


def test_attitude_that_differs_by_whole_turns_fits_the_odometry_as_recorded() -> None:
    path = make_vehicle_path()
    rolled = path @ make_pose(np.zeros(3), Rotation.from_euler("x", 1.0))
    readings = depth_roll_pitch(path) + np.array([0.0, 2 * np.pi, 0.0])
    navigation: Any = SimpleNamespace(depth_attitude=SimpleNamespace(z_roll_pitch=readings))
    hypotheses = {AS_RECORDED: SimpleNamespace(world_from_vehicle=path)}
    hypotheses["fault"] = SimpleNamespace(world_from_vehicle=rolled)
    test: Any = SimpleNamespace(hypotheses=hypotheses, likely_fault="fault")
    assert _attitude_fits(test, navigation)


def test_pairs_across_a_step_that_odometry_does_not_know_test_nothing(sequence: Sequence, stub: Stub) -> None:
    poses = make_vehicle_path()
    stub("initialise_from_odometry", InitialPoses(poses, "sensors", np.arange(len(poses) - 1) == 8))  # type: ignore
    nothing = np.zeros((0, 2))
    frames = [(7, 8), (8, 9), (7, 9), (6, 10), (9, 10), (6, 8)]
    stub("collect_point_pairs", [PointPairs(a, b, nothing, nothing, np.eye(4)) for a, b in frames])
    reduced = stub("planar_inliers", lambda pairs, _: pairs)
    tested = stub("compare_odometry_hypotheses", None)
    navigation = read_navigation(sequence, BackendConfig())
    rematch_suspected(MatchedSequence(sequence, [], []), navigation, Config(), RECORDER, StageClock())
    for pairs in (reduced[0][0], tested[0][2], tested[0][-1]):
        assert [(pair.frame_a, pair.frame_b) for pair in pairs] == [(7, 8), (9, 10), (6, 8)]


def test_without_odometry_nothing_is_tested(sequence: Sequence, stub: Stub) -> None:
    tested = stub("compare_odometry_hypotheses", None)
    given = MatchedSequence(sequence, [], [])
    none = FrameNavigation(None, read_navigation(replace(sequence, odometry=None), BackendConfig()).depth_attitude)
    assert rematch_suspected(given, none, Config(), RECORDER, StageClock()) is given and not tested


def test_image_jumps_are_added_to_the_diagnostics_with_the_poses_of_the_sonar(sequence: Sequence, stub: Stub) -> None:
    start = initialise_from_odometry(read_navigation(sequence, BackendConfig()), sequence)
    assert start is not None
    jumps = np.zeros(len(start.unreliable), dtype=bool)
    jumps[[3, 8]] = True
    unreliable = np.arange(len(jumps)) == 8
    sought = stub("find_image_jumps", jumps)
    keypoints = [make_keypoints(np.ones(frame), np.zeros(frame)) for frame in range(len(sequence))]
    found = report_image_jumps(replace(start, unreliable=unreliable), sequence, [], keypoints, Config())
    assert found.sensors.diagnostics[-1].frames == ((3, 4),), "steps that odometry does not know are left out"
    np.testing.assert_array_equal(sought[0][0], start.world_from_vehicle @ sequence.vehicle_from_sonar)
    np.testing.assert_array_equal(sought[0][3], np.arange(len(sequence)))


def test_broken_order_is_added_to_the_diagnostics(stub: Stub) -> None:
    sequence = make_vehicle_sequence()
    start = initialise_from_odometry(read_navigation(sequence, BackendConfig()), sequence)
    assert start is not None
    keypoints: Any = ["keypoints"]
    candidates: Any = ["candidates"]
    sought = stub("find_misplaced_frames", np.arange(len(sequence)) == 5)
    found = report_image_order(start, sequence, keypoints, candidates, Config())
    assert [item.code for item in found.sensors.diagnostics] == [
        *(item.code for item in start.sensors.diagnostics),
        "image-order",
    ]
    assert sought[0][:2] == (keypoints, candidates)
    np.testing.assert_array_equal(sought[0][2], feature_sigma(sequence.sonar, Config().noise))
    stub("find_misplaced_frames", np.zeros(len(sequence), dtype=bool))
    unchanged = report_image_order(start, sequence, keypoints, candidates, Config())
    assert unchanged.sensors.diagnostics == start.sensors.diagnostics
