"""The back-end's table: that its numbers are what they say, on tiny sequences and on points that are made up."""

import importlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any, cast

import gtsam
import numpy as np
import pytest

from asfm.backend.estimation.solution import Solution
from asfm.backend.graph.bundle_adjustment import Bundle
from asfm.backend.graph.factors import bearing_factor, range_factor
from asfm.backend.graph.problem import FIRST_POSE, BundleProblem
from asfm.geometry.poses import invert, transform
from asfm.geometry.sonar import project
from asfm.types import FloatArray, FrameTruth, Landmarks, Reconstruction, Tracks, Trajectory

NO_PROBLEM = cast(BundleProblem, None)


@pytest.fixture(autouse=True)
def tools(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the tools find each other, as when one is run as a script."""


def load(name: str) -> ModuleType:
    return importlib.import_module(name)


def make_floor(frames: int = 12, observations: int = 20, navigation: bool = True) -> Any:
    return load("asfm.simulation.track_simulation").make_floor(
        frames, observations, (6, frames), "sway", 1.0, navigation
    )


def test_floor_is_seen_where_it_is() -> None:
    floor, sonar = make_floor(), load("asfm.simulation.track_simulation").SONAR
    truth, tracks = floor.sequence.groundtruth.world_from_vehicle, floor.tracks
    in_sonar_m = transform(invert(truth)[tracks.frame], floor.xyz_m[tracks.track])
    assert sonar.sees(in_sonar_m).all()
    range_m, bearing_rad, _ = project(in_sonar_m)
    error = np.stack([tracks.range_m - range_m, tracks.bearing_rad - bearing_rad], axis=1) / tracks.sigma
    np.testing.assert_allclose(error.std(axis=0), 1, atol=0.2)
    np.testing.assert_allclose(tracks.sigma[0], [1.5 * sonar.range_step_m, np.deg2rad(0.3)], rtol=0.1)
    views = np.bincount(tracks.track)
    assert views.min() >= 6 and len(floor.xyz_m) == tracks.count == len(views)
    assert len(tracks) / 12 == pytest.approx(20, rel=0.1)
    assert (np.diff(tracks.track * 12 + tracks.frame) > 0).all(), "sorted by track and frame"
    assert abs(floor.xyz_m[:, 2]).max() < 1 < np.ptp(floor.xyz_m[:, :2], axis=0).min()


@pytest.mark.parametrize("kind", ["bearing", "range"])
def test_factors_in_python_are_the_native_ones(kind: str) -> None:
    """Same error and same whitened derivatives, kernel included, at a pose and a point at random."""
    rng = np.random.default_rng(4)
    native = {"bearing": bearing_factor, "range": range_factor}[kind]
    python = getattr(load("tools.benchmark.native_factors"), f"make_{kind}_factor")
    for _ in range(5):
        values = gtsam.Values()
        pose = gtsam.Pose3.Expmap(rng.normal(size=6))
        values.insert(0, pose)
        values.insert(1, pose.transformFrom(np.array([3.0, 0.5, 0.4]) + 0.2 * rng.normal(size=3)))
        reading = 3.0 if kind == "range" else 0.1
        ours, theirs = python(0, 1, reading, 0.02), native(0, 1, reading, 0.02, gtsam.Pose3())
        assert ours.error(values) == pytest.approx(theirs.error(values), rel=1e-9)
        for mine, other in zip(ours.linearize(values).jacobian(), theirs.linearize(values).jacobian(), strict=True):
            np.testing.assert_allclose(mine, other, atol=1e-8)


def test_speed_is_told(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    benchmark, solver = load("tools.benchmark.__main__"), load("tools.benchmark.native_factors")
    monkeypatch.setattr(benchmark, "compare_factors", lambda: solver.compare_factors(6, 15))
    code = benchmark.main(["backend-speed", "--frames", "12", "--observations", "10"])
    lines = {line.split("  ")[0]: line.split() for line in capsys.readouterr().out.splitlines()}
    assert lines["native factors, farthest pose from that optimum"][-1] == "yes", "both solve the same"
    assert code == (1 if lines["native factors, faster"][-1] == "NO" else 0)
    seconds = {name: float(cells[-2]) for name, cells in lines.items() if cells[-1] == "s"}
    rounds = sum(value for name, value in seconds.items() if ", round" in name)
    assert lines["12 frames, in all"][-1] == "yes"
    assert float(lines["12 frames, in all"][-3]) == pytest.approx(rounds + seconds["12 frames, landmarks"], rel=0.02)
    assert 50 < float(lines["12 frames, peak memory"][-3].replace(",", "")) < 3000


def make_solution(sigma: FloatArray, error: FloatArray, frames: int) -> tuple[Solution, FloatArray]:
    """Poses of which a prior with (6,) sigmas says all, and the truth which lies (frames, 6) beside them."""
    graph, values, truth = gtsam.NonlinearFactorGraph(), gtsam.Values(), []
    rng = np.random.default_rng(2)
    for index in range(frames):
        pose = gtsam.Pose3.Expmap(rng.normal(size=6))
        graph.add(gtsam.PriorFactorPose3(FIRST_POSE + index, pose, gtsam.noiseModel.Diagonal.Sigmas(sigma)))
        values.insert(FIRST_POSE + index, pose)
        truth.append(pose.retract(error[index]).matrix())
    poses = np.stack([values.atPose3(FIRST_POSE + index).matrix() for index in range(frames)])
    nothing = np.zeros(0)
    tracks = Tracks(nothing.astype(int), nothing.astype(int), nothing, nothing)
    bundle = Bundle(poses, np.zeros((0, 3)), np.zeros(0, dtype=bool), graph, graph, values)
    return Solution(tracks, np.zeros(0, dtype=bool), bundle, NO_PROBLEM, np.zeros(0)), np.stack(truth)


def test_nees_is_one_where_covariances_are_true() -> None:
    measure_nees = load("asfm.evaluation.covariance_consistency").measure_nees
    rng, sigma = np.random.default_rng(0), np.array([0.01, 0.03, 0.02, 0.3, 0.1, 0.05])
    error = sigma * rng.normal(size=(400, 6))
    error[0] = 100 * sigma  # of the first pose, which does not count
    position, attitude = measure_nees(*make_solution(sigma, error, 400))
    assert position == pytest.approx(np.mean((error / sigma)[1:, 3:] ** 2), rel=1e-6)
    assert (position, attitude) == pytest.approx((1, 1), abs=0.12)
    twice = error * [1, 1, 1, 2, 2, 2]
    position, attitude = measure_nees(*make_solution(sigma, twice, 400))
    assert (position, attitude) == pytest.approx((4, 1), rel=0.12), "position and attitude are told apart"
    solution, truth = make_solution(sigma, error, 3)
    graph = gtsam.NonlinearFactorGraph()
    for key in (FIRST_POSE, FIRST_POSE + 1):  # nothing holds the first pose
        noise = gtsam.noiseModel.Isotropic.Sigma(6, 1.0)
        graph.add(gtsam.BetweenFactorPose3(key, key + 1, gtsam.Pose3(), noise))
    loose = replace(solution, bundle=replace(solution.bundle, graph=graph))
    assert measure_nees(loose, truth) is None


def test_the_interval_is_what_draws_fall_into() -> None:
    low, high = load("tools.benchmark.backend").nees_interval(10)
    means = np.mean(np.random.default_rng(0).normal(size=(4000, 30)) ** 2, axis=1)
    assert np.mean((means > low) & (means < high)) == pytest.approx(0.95, abs=0.015)
    assert low < 1 < high


def read_floor_truth(floor: Any) -> Callable[[int], FrameTruth]:
    """Give frames in which nothing echoes but the points, each from the pixel that it was observed in."""
    sonar, tracks = floor.sequence.sonar, floor.tracks
    sonar_from_world = invert(floor.sequence.groundtruth.world_from_vehicle)
    elevation_rad = project(transform(sonar_from_world[tracks.frame], floor.xyz_m[tracks.track]))[2]
    row = np.minimum(sonar.row_at_range(tracks.range_m).astype(int), sonar.shape[0] - 1)
    column = np.minimum(sonar.column_at_bearing(tracks.bearing_rad).astype(int), sonar.shape[1] - 1)

    def read_truth(index: int) -> FrameTruth:
        here, image = tracks.frame == index, np.full(sonar.shape, np.nan)
        image[row[here], column[here]] = elevation_rad[here]
        return FrameTruth(image, np.zeros(sonar.shape, np.float32))

    return read_truth


def test_landmarks_are_held_against_their_true_points() -> None:
    """Landmarks moved by known distances, in the true world and in one of their own."""
    judge, floor = load("asfm.evaluation.covariance_consistency").judge_landmarks, make_floor()
    read_truth, sequence, tracks = read_floor_truth(floor), floor.sequence, floor.tracks
    poses, every = sequence.groundtruth.world_from_vehicle, np.arange(tracks.count)
    landmarks = Landmarks(
        track=every,
        xyz_m=floor.xyz_m + np.where(every % 4 == 0, 0.5, 0.02)[:, None] * [0, 0, 1],
        covariance_m2=np.tile(0.01 * np.eye(3), (len(every), 1, 1)),
        sigma_m=np.full(len(every), 0.1),
        views=np.bincount(tracks.track),
        well_constrained=every % 2 == 0,
        arc_m=np.zeros((len(every), 1, 3)),
    )
    trajectory = Trajectory(sequence.timestamps_s, poses)
    result = Reconstruction(trajectory, tracks, np.ones(len(tracks), bool), landmarks, np.zeros((0, 6, 6)), ())
    quality = judge(result, sequence, read_truth, False)
    assert (
        (quality.tracks, quality.called) == (len(every), len(quality.error_m)) == (len(every), np.sum(every % 2 == 0))
    )
    assert quality.near == pytest.approx(0.5, abs=0.06) and 0.01 < quality.median_m < 0.55

    elsewhere = np.linalg.inv(poses[0])
    own_world = replace(landmarks, xyz_m=transform(elsewhere, landmarks.xyz_m))
    bent = elsewhere @ poses
    bent[1:, :3, 3] *= 1.5  # only the first pose counts
    moved = replace(result, trajectory=replace(trajectory, world_from_vehicle=bent), landmarks=own_world)
    assert judge(moved, sequence, read_truth, True).median_m == pytest.approx(quality.median_m, rel=1e-6)
    assert judge(moved, sequence, read_truth, False).near == 0

    nothing = replace(result, landmarks=replace(landmarks, well_constrained=np.zeros(len(every), bool)))
    empty = judge(nothing, sequence, read_truth, False)
    assert (empty.share, empty.near, empty.median_m) == (0, None, None)
    pooled = load("asfm.evaluation.covariance_consistency").pool_landmarks([quality, empty, quality])
    assert pooled.share == pytest.approx(quality.share * 2 / 3) and pooled.near == quality.near


def test_the_table_judges_means_and_worst_cases() -> None:
    table, accuracy, sequences = (
        load(f"tools.benchmark.{name}") for name in ("backend", "accuracy", "simulated_cases")
    )
    task = table.Task(sequences.Case("pier", "didson", 0, 8), ("odometry",))
    make: Callable[..., Any] = accuracy.Accuracy
    runs = [(task, make(f"run{n}", "odometry", ate_m=ate, odometry_ate_m=1.0)) for n, ate in enumerate([0.3, 1.1])]
    runs.append((task, make("lost", "sonar", ate_m=0.2, path_m=1.0)))
    runs.append((task, make("knows", "sonar", ate_m=0.3, path_m=1.0, distrusted=True)))
    runs.append((task, make("broken", "odometry", failure="ValueError: no")))
    numbers = {number.what: number for number in table.list_backend_numbers(runs)}
    assert numbers["runs that failed"].ok is False
    mean, worst = numbers["odometry, ATE / odometry, mean of 2"], numbers["odometry, ATE / odometry, worst: run1"]
    assert (mean.reached, mean.ok, worst.reached, worst.ok) == (pytest.approx(0.7), True, 1.1, False)
    told = numbers["sonar alone, ATE above 10 % of the path: share that says so, of 2"]
    assert (told.reached, told.ok) == (0.5, False)
    assert numbers["sonar, ATE / path, mean of 2"].reached == pytest.approx(0.25)
    assert "failed: ValueError: no" in accuracy.describe_accuracy(runs[-1][1])
    both = table.Requirement("NEES", 1.5, at_least=0.5, at_most=1.2)
    assert both.ok is False and both.cells()[1] == "0.5 to 1.2"


def test_cases_differ_by_name_and_the_narrow_ones_by_their_haste() -> None:
    """A fast path is at every frame where the usual one is later, but for where the middle of the sequence is."""
    sequences = load("tools.benchmark.simulated_cases")
    usual = sequences.Case("seafloor", "didson", 1, 13, "transect")
    narrow = sequences.list_narrow_cases(2, 13)
    others = [usual, replace(usual, seed=2), replace(usual, frames=8), replace(usual, motion="")]
    assert len({case.name for case in (*narrow, *others)}) == 2 * len(sequences.SPEED_FACTORS) + 4
    slow_m = sequences._speed_up(usual).world_from_vehicle[:, :3, 3]
    for case in narrow[1::2]:
        fast_m = sequences._speed_up(case).world_from_vehicle[:, :3, 3]
        np.testing.assert_allclose(fast_m[1] - fast_m[0], slow_m[int(case.speed_factor)] - slow_m[0], atol=1e-6)


def test_every_line_is_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """One scene before one sonar, in all modes; the narrow one; and what goes wrong."""
    monkeypatch.setattr(load("tools.benchmark.simulated_cases"), "SPEED_FACTORS", (4.0,))
    main = load("tools.benchmark.__main__").main
    few = ["--frames", "5", "--seeds", "1", "--cache", str(tmp_path), "--set", "backend.rounds=1"]
    command = ["backend", "--scenes", "tank", "--sonars", "didson", *few]
    assert main(command) == 1, "five frames do not reach everything"
    lines = capsys.readouterr().out.splitlines()
    runs, table = lines[: lines.index("")], lines[lines.index("") + 1 :]
    assert [line.split(":")[0].split(", ")[-1] for line in runs] == ["navigation", "odometry", "sonar", "sonar"]
    assert all(line.count("ATE ") == 1 for line in runs) and sum("of the bound" in line for line in runs) >= 2
    for title in ("navigation, ATE / bound, mean of 1", "navigation, NEES a degree of freedom, position, mean of 1"):
        assert sum(line.startswith(title) for line in table) == 1, title
    assert any(line.startswith("narrow sonar alone, ATE / path, worst: seafloor-didson-transect-4x") for line in table)
    written = [path.stat().st_mtime_ns for path in sorted(tmp_path.glob("*/sequence.yaml"))]
    assert main([*command, "--modes", "odometry", "--jobs", "2", "--no-bound"]) == 1
    alone = capsys.readouterr().out.splitlines()[0]
    assert alone.split("; ")[:2] == runs[1].split("; ")[:2], "the same in a process of its own"
    assert [path.stat().st_mtime_ns for path in sorted(tmp_path.glob("*/sequence.yaml"))] == written, "made once"
    assert main(["backend", "--scenes", "nowhere", *few]) == 1
    assert "nowhere" in capsys.readouterr().err
