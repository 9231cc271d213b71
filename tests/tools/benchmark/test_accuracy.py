"""Accuracy of one run: its errors, and whether its diagnostics flag it."""

import numpy as np
import pytest

from asfm.config import Config
from asfm.diagnostics import Diagnostic
from asfm.geometry.poses import invert
from asfm.geometry.reflection import reflect_after
from asfm.simulation.track_simulation import TrackSimulation, simulate_tracks
from asfm.types import Landmarks, Reconstruction, Trajectory
from tools.benchmark.accuracy import Accuracy, EvaluatedSequence, _compare, describe_accuracy


@pytest.fixture(scope="module")
def floor() -> TrackSimulation:
    return simulate_tracks(6, 10, (3, 6), "sway", 1.0, navigation=False)


def compare(floor: TrackSimulation, mode: str, code: str, mirrored: bool = False) -> Accuracy:
    """Compare the true poses, moved into a world of their own for the sonar alone, with the truth."""
    assert floor.sequence.groundtruth is not None
    truth = floor.sequence.groundtruth.world_from_vehicle
    poses = invert(truth[0]) @ truth if mode == "sonar" else truth
    if mirrored:
        poses = reflect_after(poses, 0, floor.sequence.vehicle_from_sonar)
    nothing = np.zeros(0, dtype=np.int64)
    landmarks = Landmarks(
        track=nothing,
        xyz_m=np.zeros((0, 3)),
        covariance_m2=np.zeros((0, 3, 3)),
        sigma_m=np.zeros(0),
        views=nothing,
        well_constrained=np.zeros(0, dtype=bool),
        arc_m=np.zeros((0, 1, 3)),
    )
    result = Reconstruction(
        trajectory=Trajectory(floor.sequence.timestamps_s, poses),
        tracks=floor.tracks,
        observed=np.ones(len(floor.tracks), dtype=bool),
        landmarks=landmarks,
        pose_covariance=np.tile(np.eye(6), (6, 1, 1)),
        diagnostics=(Diagnostic(code, "about frame 3, not to be trusted"),),
    )
    return _compare(EvaluatedSequence("floor", floor.sequence, None), mode, result, 2.0, Config(), with_bound=True)


@pytest.mark.parametrize("mode", ["odometry", "sonar"])
def test_exact_poses_have_no_error_in_either_world(floor: TrackSimulation, mode: str) -> None:
    run = compare(floor, mode, "navigation-gap")
    assert run.ate_m == pytest.approx(0, abs=1e-9) and run.odometry_ate_m is not None
    assert run.nees is not None and (run.nees.position, run.nees.attitude) == pytest.approx((0, 0), abs=1e-9)
    assert (run.bound_m, run.landmarks) == (None, None), "without true elevations"
    assert (run.ratio is None) == (mode == "sonar")
    assert describe_accuracy(run).startswith(f"floor, {mode}: ATE 0.0000 m; 0.00 % of the path")


@pytest.mark.parametrize(("code", "flagged"), [("position-uncertainty", True), ("navigation-gap", False)])
def test_a_run_is_flagged_by_the_code_of_its_diagnostic(floor: TrackSimulation, code: str, flagged: bool) -> None:
    run = compare(floor, "odometry", code)
    assert run.flagged is flagged
    assert ("flagged as not to be trusted" in describe_accuracy(run)) is flagged


def test_the_mirror_image_counts_for_the_sonar_alone_only(floor: TrackSimulation) -> None:
    assert compare(floor, "sonar", "mirror-ambiguity", mirrored=True).ate_m == pytest.approx(0, abs=1e-9)
    assert compare(floor, "odometry", "mirror-ambiguity", mirrored=True).ate_m > 1e-3
