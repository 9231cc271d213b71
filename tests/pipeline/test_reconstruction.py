"""Wiring of the reconstruction: every stage runs, in its order, on what the stage before it returned."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from asfm.backend.graph.self_calibration import Calibration
from asfm.backend.initialisation.initial_poses import InitialPoses
from asfm.config import Config, NoiseConfig
from asfm.pipeline import reconstruction
from asfm.pipeline.image_faults import MatchedSequence
from asfm.sequence import Sequence
from asfm.stages import StageClock
from tests.pipeline.stubs import Calls, stub_stages
from tests.worlds import make_keypoints, make_vehicle_sequence

Stub = Callable[[str, Any], Calls]
CONFIG = Config.model_validate({"seed": 7, "backend": {"scene": "above", "motion_prior_factor": 2.5}})
NAVIGATION: Any = SimpleNamespace(odometry="odometry")
KEYPOINTS: Any = [make_keypoints(np.array([1.0, 2.0]), np.zeros(2))]
NOT_REQUESTED = Calibration(np.zeros(3), 0.0, np.zeros(4))


@pytest.fixture
def stub(monkeypatch: pytest.MonkeyPatch) -> Stub:
    return stub_stages(monkeypatch, "reconstruction")


@pytest.fixture(scope="module")
def sequence() -> Sequence:
    """A vehicle whose sonar sits on a lever arm, so that a forgotten one is seen."""
    sequence = make_vehicle_sequence()
    assert not np.allclose(sequence.vehicle_from_sonar, np.eye(4))
    return sequence


def initial_poses(unreliable: bool = False, measured: bool = True) -> Any:
    sensors: Any = SimpleNamespace(measured=measured, diagnostics=("of the sensors",))
    return InitialPoses(np.eye(4)[None], sensors, np.array([False, unreliable]))


def solved(poses: Any, observed: int = 3) -> Any:
    bundle = SimpleNamespace(world_from_vehicle=poses, xyz_m="points", in_graph="in graph")
    return SimpleNamespace(bundle=bundle, tracks="tracks", observed=np.ones(observed, dtype=bool))


@pytest.mark.parametrize("measured", [False, True])
def test_ambiguities_are_treated_in_order_and_only_without_odometry(
    measured: bool, stub: Stub, sequence: Sequence
) -> None:
    dropped = stub("drop_duplicate_frames", (["kept"], ("repeated frames",)))
    stub("initialise", initial_poses(measured=measured))
    optimised = stub("optimise", ["optimised"])
    stub("estimate_calibration", NOT_REQUESTED)
    stub("widen_motion_prior", lambda solution, *_: [*solution, "prior widened"])
    stub("correct_partial_mirroring", lambda solution, *_: [*solution, "partial mirroring corrected"])
    chosen = stub("choose_mirror", lambda solution, _: [*solution, "mirror image chosen"])
    stated = stub("state_prior_covariance", lambda solution, _: [*solution, "covariance stated"])
    given: Any = ["given"]
    found: Any = reconstruction.estimate(sequence, NAVIGATION, KEYPOINTS, given, CONFIG, StageClock())
    ambiguity = ["prior widened", "partial mirroring corrected", "mirror image chosen", "covariance stated"]
    assert found[1] == (["optimised"] if measured else ["optimised", *ambiguity])
    assert found[2] == ("of the sensors", "repeated frames")
    assert dropped == [(KEYPOINTS, ["given"], "odometry")]
    assert [call[2] for call in optimised] == [["kept"]]
    assert [call[1] for call in chosen] == ([] if measured else ["above"])
    assert [call[1] for call in stated] == ([] if measured else [2.5])


def test_a_calibration_is_applied_and_everything_optimised_again(stub: Stub, sequence: Sequence) -> None:
    """The second optimisation begins at the poses of the first, with corrected sequence and keypoints."""
    calibration = Calibration(np.array([0.02, 0.0, 0.0]), 0.1, np.ones(4))
    better, poses = replace(sequence, name="calibrated"), [np.full((1, 4, 4), 5.0), np.full((1, 4, 4), 6.0)]
    stub("drop_duplicate_frames", ([], ()))
    stub("initialise", initial_poses())
    solutions = [solved(pose) for pose in poses]
    optimised = stub("optimise", lambda *_: solutions.pop(0))
    stub("estimate_calibration", calibration)
    applied = stub("apply_calibration", (better, ["corrected keypoints"]))
    found = reconstruction.estimate(sequence, NAVIGATION, KEYPOINTS, [], CONFIG, StageClock(), False)
    assert applied == [(calibration, sequence, KEYPOINTS)] and len(optimised) == 2
    assert optimised[1][:2] == (better, ["corrected keypoints"])
    assert optimised[1][3].world_from_vehicle is poses[0]
    assert all(call[-1] is False for call in optimised)
    assert found[0] is better and found[1].bundle.world_from_vehicle is poses[1]
    assert [item.code for item in found[2][1:]] == ["estimated-lever-rotation", "estimated-range-bias"]


@pytest.mark.parametrize("odometry", ["none", "reliable", "unreliable"])
def test_odometry_is_verified_and_what_is_missing_or_unreliable_comes_from_tracks(
    odometry: str, stub: Stub, sequence: Sequence
) -> None:
    start = initial_poses(odometry == "unreliable")
    stub("initialise_from_odometry", None if odometry == "none" else "recorded")
    stub("collect_point_pairs", lambda *_: "pairs")
    jumps = stub("report_image_jumps", lambda recorded, *_: f"{recorded}, jumps reported")
    verified = stub("verify_odometry", start)
    stub("build_tracks", lambda *_: SimpleNamespace(count=3))
    from_tracks, replaced = stub("initialise_from_tracks", "from tracks"), stub("replace_unreliable_steps", "replaced")
    stub("search_from_tracks", lambda planar, *_: f"{planar}, searched")
    ordered = stub("report_image_order", lambda searched, *_: f"{searched}, order reported")
    found: Any = reconstruction.initialise(sequence, NAVIGATION, KEYPOINTS, [], CONFIG, StageClock())
    if odometry == "none":
        assert found == "from tracks, searched, order reported" and not verified and not replaced
        assert [call[1:] for call in ordered] == [(sequence, KEYPOINTS, [], CONFIG)]
        rng = from_tracks[0][-1]
    else:
        assert found == "replaced" if odometry == "unreliable" else found is start
        assert [call[:3] for call in jumps] == [("recorded", sequence, "pairs")]
        assert [call[:3] for call in verified] == [("recorded, jumps reported", sequence, "pairs")]
        assert [call[0] for call in replaced] == ([start] if odometry == "unreliable" else [])
        rng = verified[0][-1]
    assert rng.integers(1 << 30) == np.random.default_rng(7).integers(1 << 30), "the seed is that of the configuration"


LOOPS: Any = SimpleNamespace(world_from_vehicle=np.full((1, 4, 4), 50.0), matches=["loop"])


def run_rounds(stub: Stub, sequence: Sequence, **settings: Any) -> dict[str, Calls]:
    """Run three rounds with poses 1, 2 and 3 on stand-ins; the loops move the poses to 50."""
    config = Config.model_validate(
        {"backend": {"rounds": 3}, "tracks": {"settled_share": 0.2}, "loops": {"enabled": settings.get("loops", True)}}
    )
    calls = {"associate": stub("associate", lambda *_: SimpleNamespace(count=1))}
    calls["solve_tracks"] = stub(
        "solve_tracks", lambda *_: solved(np.full((1, 4, 4), float(len(calls["solve_tracks"]))))
    )
    calls["share_changed"] = stub("share_changed", settings.get("changed", 1.0))
    calls["find_loops"] = stub("find_loops", LOOPS)
    calls["TriangulatedTracks"] = stub("TriangulatedTracks", "triangulated")
    calls["match_to_landmarks"] = stub("match_to_landmarks", ["guided"])
    calls["add_matches"] = stub("add_matches", lambda known, found: [*known, *found])
    candidates: Any = ["candidate"]
    reconstruction.optimise(
        sequence, KEYPOINTS, candidates, initial_poses(), config, StageClock(), settings.get("may_add", True)
    )
    return calls


def test_each_round_uses_the_poses_loops_and_guided_matches_of_the_one_before(stub: Stub, sequence: Sequence) -> None:
    """Association and guided matching see the poses of the sonar, not those of the vehicle."""
    calls = run_rounds(stub, sequence)
    matches = [call[1] for call in calls["associate"]]
    assert matches == [["candidate"], ["candidate", "loop", "guided"], ["candidate", "loop", "guided", "guided"]]
    lever = sequence.vehicle_from_sonar
    for name, index, expected in (
        ("associate", 3, [np.eye(4)[None] @ lever, np.full((1, 4, 4), 50.0) @ lever, np.full((1, 4, 4), 2.0) @ lever]),
        ("solve_tracks", 2, [np.eye(4)[None], np.full((1, 4, 4), 50.0), np.full((1, 4, 4), 2.0)]),
        ("TriangulatedTracks", 4, [np.full((1, 4, 4), 1.0) @ lever, np.full((1, 4, 4), 2.0) @ lever]),
    ):
        np.testing.assert_allclose([call[index] for call in calls[name]], expected, err_msg=name)
    assert [call[5] for call in calls["solve_tracks"]] == [False, True, True], "the first round begins unadjusted"
    assert [call[3] for call in calls["TriangulatedTracks"]] == ["in graph"] * 2
    assert [call[0] for call in calls["match_to_landmarks"]] == ["triangulated"] * 2
    assert len(calls["find_loops"]) == 1, "loops are sought once, after the first round"


def test_rounds_end_when_settled(stub: Stub, sequence: Sequence) -> None:
    assert len(run_rounds(stub, sequence, changed=0.1)["solve_tracks"]) == 2


def test_loops_that_are_switched_off_are_not_sought(stub: Stub, sequence: Sequence) -> None:
    calls = run_rounds(stub, sequence, loops=False)
    assert not calls["find_loops"] and len(calls["match_to_landmarks"]) == 2


def test_given_matches_are_not_added_to(stub: Stub, sequence: Sequence) -> None:
    calls = run_rounds(stub, sequence, may_add=False)
    assert not calls["find_loops"] and not calls["match_to_landmarks"]
    assert [call[1] for call in calls["associate"]] == [["candidate"]] * 3


@pytest.mark.parametrize("external", [None, "external"])
def test_a_run_hands_every_stage_the_results_of_those_before(external: Any, stub: Stub, sequence: Sequence) -> None:
    shown: list[tuple[Any, ...]] = []
    recorder: Any = SimpleNamespace(record_reconstruction=lambda *args: shown.append(args))
    stub("move_to_local_origin", ("local", "origin"))
    read = stub("read_navigation", "navigation")
    predicted = stub("predict_poses", "prediction")
    noisy = CONFIG.model_copy(update={"noise": NoiseConfig(range_bins=0.7)})
    estimated_noise = stub("estimate_noise", noisy)
    extracted = stub("extract_matches", (KEYPOINTS, ["match"] if external else ["gated"]))
    turned = replace(sequence, name="turned")
    rematched = stub("rematch_suspected", MatchedSequence(turned, KEYPOINTS, ["match"], ("turned",)))  # type: ignore
    estimated = stub("estimate", ("calibrated", "solution", ("found",)))
    summarised = stub("summarise", "summary about the local origin")
    shifted = stub("shift_reconstruction", "summary")
    stub("with_world_of", lambda *args: args)
    run: Any = reconstruction.reconstruct(sequence, CONFIG, recorder, external=external)
    assert read == [("local", CONFIG.backend)]
    assert predicted == [("navigation", "local")]
    assert estimated_noise[0][:2] == ("local", CONFIG) and estimated_noise[0][-1] == external
    assert extracted[0][:2] == ("local", noisy)
    assert extracted[0][-2:] == ("prediction", external)
    assert estimated[0][:4] == ("local" if external else turned, "navigation", KEYPOINTS, ["match"])
    assert estimated[0][4] is noisy and summarised[0][2] is noisy
    assert estimated[0][-1] is (external is None), "only asfm's own matches are added to"
    found = ("found",) if external else ("turned", "found")
    assert summarised[0][:2] == ("calibrated", "solution") and summarised[0][-1] == found
    assert len(rematched) == (external is None), "given matches are not made again"
    if rematched:
        assert rematched[0][0].sequence == "local" and rematched[0][0].matches == ["gated"]
        assert rematched[0][1:4] == ("navigation", noisy, recorder)
    assert shifted == [("summary about the local origin", "origin")]
    assert shown == [(("calibrated", sequence), "summary")]
    assert run.reconstruction == "summary" and run.matches == ("match",)
    assert run.keypoints[0].patches.size == 0 and len(run.keypoints[0]) == 2
