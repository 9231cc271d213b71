"""Native GTSAM factors against the same factors in Python: time and optimum of the bundle adjustment."""

import time
from collections.abc import Callable, Iterator
from typing import Any

import gtsam
import numpy as np

from asfm.backend.graph.bundle_adjustment import adjust_bundle
from asfm.backend.graph.factors import (
    UNKNOWN_ELEVATION_SIGMA,
    bearing_factor,
    cauchy,
    first_pose_factor,
    range_factor,
    sonar_from_beam,
    step_factor,
)
from asfm.backend.graph.problem import FIRST_POINT, FIRST_POSE, BundleProblem
from asfm.backend.initialisation.initial_poses import InitialPoses, initialise_from_odometry
from asfm.config import BackendConfig
from asfm.navigation.frame_navigation import read_navigation
from asfm.simulation.track_simulation import TrackSimulation, simulate_tracks
from asfm.types import FloatArray
from tools.benchmark.table import Requirement

MIN_SPEEDUP, MAX_DIFFERENCE_M = 20.0, 1e-4
SMALL_FRAMES, SMALL_POINTS = 20, 100
RELATIVE_COST_TOLERANCE = 1e-6
"""Relative change of the cost at which either optimiser stops."""
HALF_APERTURE_RAD = 1.0
"""Half an elevation aperture that no point leaves, so that no aperture constraint is active."""

Factor = Callable[[int, int, float, float], Any]
"""(pose key, point key, measured value, sigma) -> factor."""


def compare_factors(frames: int = SMALL_FRAMES, points: int = SMALL_POINTS) -> Iterator[Requirement]:
    """Solve the same graph from the same initial values with native factors and with factors in Python."""
    floor = simulate_tracks(frames, points, (max(frames // 2, 3), frames), "sway", 2.0, navigation=False)
    initial = initialise_from_odometry(read_navigation(floor.sequence, BackendConfig()), floor.sequence)
    assert initial is not None
    lever_arm = gtsam.Pose3(floor.sequence.vehicle_from_sonar)
    native: tuple[Factor, Factor] = (
        lambda pose, point, value, sigma: bearing_factor(pose, point, value, sigma, lever_arm),
        lambda pose, point, value, sigma: range_factor(pose, point, value, sigma, lever_arm),
    )
    python_s, expected = _time_graph(floor, initial, (make_bearing_factor, make_range_factor))
    native_s, poses = _time_graph(floor, initial, native)
    ours_s, ours = _time_adjustment(floor, initial)
    yield Requirement("observations of the small graph", float(len(floor.tracks)))
    yield Requirement("factors in Python", python_s, "s")
    yield Requirement("native factors", native_s, "s")
    yield Requirement("native factors, faster", python_s / native_s, "times", at_least=MIN_SPEEDUP)
    yield Requirement(
        "native factors, largest pose difference from that optimum",
        _largest_distance_m(poses, expected),
        "m",
        at_most=MAX_DIFFERENCE_M,
    )
    yield Requirement("adjust_bundle as a whole", ours_s, "s")
    yield Requirement("adjust_bundle as a whole, faster", python_s / ours_s, "times")
    yield Requirement(
        "adjust_bundle as a whole, largest pose difference from that optimum", _largest_distance_m(ours, expected), "m"
    )


def _time_graph(
    floor: TrackSimulation, initial: InitialPoses, factors: tuple[Factor, Factor]
) -> tuple[float, FloatArray]:
    """Optimise by Levenberg-Marquardt; return the seconds without building the graph, and (N, 4, 4) poses."""
    tracks, sensors = floor.tracks, initial.sensors
    assert tracks.sigma is not None
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(first_pose_factor(FIRST_POSE, sensors.first_pose, sensors.first_sigma))
    for index, step in enumerate(sensors.steps):
        graph.add(step_factor(FIRST_POSE + index, FIRST_POSE + index + 1, step, *sensors.step_sigma[index].tolist()))
    for index in range(len(tracks)):
        pose, point = FIRST_POSE + int(tracks.frame[index]), FIRST_POINT + int(tracks.track[index])
        range_sigma, bearing_sigma = tracks.sigma[index].tolist()
        graph.add(factors[0](pose, point, float(tracks.bearing_rad[index]), bearing_sigma))
        graph.add(factors[1](pose, point, float(tracks.range_m[index]), range_sigma))
    for index, matrix in enumerate(initial.world_from_vehicle):
        values.insert(FIRST_POSE + index, gtsam.Pose3(matrix))
    for index, xyz_m in enumerate(floor.xyz_m):
        values.insert(FIRST_POINT + index, xyz_m)
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(RELATIVE_COST_TOLERANCE)
    begin_s = time.perf_counter()
    values = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
    wall_s = time.perf_counter() - begin_s
    return wall_s, np.stack([values.atPose3(FIRST_POSE + index).matrix() for index in range(len(floor.sequence))])


def _time_adjustment(floor: TrackSimulation, initial: InitialPoses) -> tuple[float, FloatArray]:
    """Adjust the same graph in the back-end; return the seconds with building the graph, and (N, 4, 4) poses."""
    assert floor.tracks.sigma is not None
    problem = BundleProblem(
        tracks=floor.tracks,
        observed=np.ones(len(floor.tracks), dtype=bool),
        sigma=floor.tracks.sigma,
        sensors=initial.sensors,
        vehicle_from_sonar=floor.sequence.vehicle_from_sonar,
        half_aperture_rad=HALF_APERTURE_RAD,
    )
    begin_s = time.perf_counter()
    bundle = adjust_bundle(problem, initial.world_from_vehicle, floor.xyz_m, RELATIVE_COST_TOLERANCE)
    return time.perf_counter() - begin_s, bundle.world_from_vehicle


def _largest_distance_m(poses: FloatArray, expected: FloatArray) -> float:
    return float(np.linalg.norm((poses - expected)[:, :3, 3], axis=1).max())


def make_bearing_factor(pose_key: int, point_key: int, bearing_rad: float, sigma_rad: float) -> Any:
    """Return :func:`asfm.backend.graph.factors.bearing_factor` without a lever arm as a factor in Python.

    The error is (x, y) / z of the point in the beam's frame (x lateral, y vertical, z along the beam).
    """
    beam_from_sonar = sonar_from_beam(bearing_rad).matrix().T

    def error_and_jacobians(_factor: Any, values: gtsam.Values, jacobians: list[FloatArray] | None) -> FloatArray:
        in_sonar_m, sonar_from_world = _point_in_sonar(values, pose_key, point_key)
        x, y, z = beam_from_sonar @ in_sonar_m
        if jacobians is not None:
            by_point = np.array([[1 / z, 0, -x / z**2], [0, 1 / z, -y / z**2]]) @ beam_from_sonar
            jacobians[0] = by_point @ _pose_jacobian(in_sonar_m)
            jacobians[1] = by_point @ sonar_from_world
        return np.array([x / z, y / z])

    return gtsam.CustomFactor(
        cauchy(np.array([sigma_rad, UNKNOWN_ELEVATION_SIGMA])), [pose_key, point_key], error_and_jacobians
    )


def make_range_factor(pose_key: int, point_key: int, range_m: float, sigma_m: float) -> Any:
    """Return :func:`asfm.backend.graph.factors.range_factor` without a lever arm as a factor in Python."""

    def error_and_jacobians(_factor: Any, values: gtsam.Values, jacobians: list[FloatArray] | None) -> FloatArray:
        in_sonar_m, sonar_from_world = _point_in_sonar(values, pose_key, point_key)
        distance_m = np.sqrt(in_sonar_m @ in_sonar_m)
        if jacobians is not None:
            by_point = in_sonar_m[None] / distance_m
            jacobians[0] = by_point @ _pose_jacobian(in_sonar_m)
            jacobians[1] = by_point @ sonar_from_world
        return np.array([distance_m - range_m])

    return gtsam.CustomFactor(cauchy(np.array([sigma_m])), [pose_key, point_key], error_and_jacobians)


def _point_in_sonar(values: gtsam.Values, pose_key: int, point_key: int) -> tuple[FloatArray, FloatArray]:
    """Return a point in the frame of a pose (3,), and the rotation from the world (3, 3)."""
    pose = values.atPose3(pose_key)
    rotation = pose.rotation().matrix().T
    return rotation @ (values.atPoint3(point_key) - pose.translation()), rotation


def _pose_jacobian(in_sonar_m: FloatArray) -> FloatArray:
    """Return the derivative (3, 6) of a point in a pose's frame by rotation and translation of that frame."""
    x, y, z = in_sonar_m
    return np.array([[0, -z, y, -1, 0, 0], [z, 0, -x, 0, -1, 0], [-y, x, 0, 0, 0, -1]], dtype=float)
