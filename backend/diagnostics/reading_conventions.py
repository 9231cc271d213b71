"""Convention test of depth and attitude against the images: signs, axes and units.

Without odometry nothing else contradicts a depth that grows downwards or a pitch of another convention: the adjustment
bends the scene to fit. The costs of the same observations under the usual conventions tell them apart. A stretch of
frames is solved under each; where one fits better there, all frames are.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation
from threadpoolctl import threadpool_limits

from asfm.backend.diagnostics.dense_adjustment import adjust_densely
from asfm.backend.diagnostics.solution_stretch import choose_stretch, select_stretch
from asfm.backend.estimation.solution import Solution
from asfm.backend.graph.bundle_adjustment import adjust_bundle
from asfm.diagnostics import Diagnostic
from asfm.geometry.poses import heading, invert, make_pose, transform
from asfm.types import FloatArray

MIN_CHANGE_SIGMAS = 5.0
"""A convention that changes no reading by more than this many sigmas is not tested."""
MIN_STRETCH_DECREASE = 2.0
"""All frames are solved again where the cost of the stretch falls by more than this."""
MIN_DECREASE = 2.5
"""A convention is reported where the cost of all frames falls by more than this: odds of 12 to 1. The observations are
those that the readings as recorded have selected, so that right ones are far from it."""
RIVAL_INCREASE = 5.0
"""Conventions whose costs differ by less than this are named beside each other."""
LEVEL_TOLERANCE = 0.05
"""A mounting is level where its rotation commutes with the reflection of the vertical up to this, as a sine."""
MIN_SPREAD_RAD = 0.15
"""Angles in degrees, read as radians, vary by more than this."""
DEGREE_RAD = float(np.deg2rad(1.0))
SWAPPED = np.array([[1.0, 0, 0], [0, 0, 1], [0, 1, 0]])


@dataclass(frozen=True, eq=False)
class ReadingConvention:
    """A convention that the readings may be in."""

    name: str
    """Completes "with ..."."""
    from_recorded: FloatArray
    """(3, 3) matrix from the recorded z_m, roll_rad and pitch_rad to those of asfm."""
    mirrored: str
    """Name of the convention in which all three have the other sign: under a level sonar the images are the same."""


def _signs(z: int, roll: int, pitch: int) -> FloatArray:
    return np.diag(np.array([z, roll, pitch], dtype=float))


CONVENTIONS = (
    ReadingConvention("z_m negated (a depth)", _signs(-1, 1, 1), "roll_rad and pitch_rad negated"),
    ReadingConvention("z_m and pitch_rad negated (NED/FRD)", _signs(-1, 1, -1), "roll_rad negated"),
    ReadingConvention("pitch_rad negated (bow up)", _signs(1, 1, -1), "z_m and roll_rad negated"),
    ReadingConvention("roll_rad and pitch_rad exchanged", SWAPPED, "them exchanged and all three negated"),
    ReadingConvention(
        "roll_rad and pitch_rad exchanged, then pitch negated",
        _signs(1, 1, -1) @ SWAPPED,
        "them exchanged, then z_m and roll negated",
    ),
    ReadingConvention(
        "roll_rad and pitch_rad exchanged, then roll negated",
        _signs(1, -1, 1) @ SWAPPED,
        "them exchanged, then z_m and pitch negated",
    ),
    ReadingConvention(
        "roll_rad and pitch_rad in degrees",
        np.diag([1.0, DEGREE_RAD, DEGREE_RAD]),
        "them in degrees, all three negated",
    ),
)


def diagnose_conventions(solution: Solution, timestamps_s: FloatArray) -> tuple[Diagnostic, ...]:
    """Report the conventions of depth and attitude that fit the images better than the recorded one.

    Args:
        solution: poses and points at the optimum.
        timestamps_s: (N,) stamps of the frames.

    Returns:
        Nothing where odometry was used: it is tested against depth and attitude on its own.
    """
    sensors = solution.problem.sensors
    if sensors.measured or not len(sensors.z_roll_pitch) or not solution.observed.any():
        return ()
    candidates = [item for item in _candidates(solution.problem.vehicle_from_sonar) if _changes(solution, item)]
    in_stretch = compare_stretch(solution, timestamps_s, candidates)
    if min(in_stretch.values(), default=0.0) > -MIN_STRETCH_DECREASE:
        return ()
    increase = compare_all(solution, candidates)
    least = min(increase.values())
    if least > -MIN_DECREASE:
        return ()
    named = "; or with ".join(
        f"{item.name}{f' or {item.mirrored}' if item.mirrored else ''} (cost lower by {-increase[item.name]:.1f})"
        for item in candidates
        if increase[item.name] < min(-MIN_DECREASE, least + RIVAL_INCREASE)
    )
    message = (
        f"depth and attitude fit the images better with {named}; nothing is changed: check signs, axes and units of "
        "the navigation (z_m grows upwards, pitch_rad is positive bow down, roll_rad positive to starboard)"
    )
    return (Diagnostic("navigation-convention", message),)


def compare_stretch(
    solution: Solution, timestamps_s: FloatArray, candidates: list[ReadingConvention]
) -> dict[str, float]:
    """Solve a stretch of frames under each convention; return by name how much its cost exceeds that as recorded.

    Args:
        solution: poses and points at the optimum.
        timestamps_s: (N,) stamps of the frames.
        candidates: conventions to try.
    """
    first, last = choose_stretch(solution)
    stretch, stamps_s = select_stretch(solution, first, last), timestamps_s[first : last + 1]
    if not len(stretch.tracks):
        return {}
    # Threads cost more than they save in matrices of this size.
    with threadpool_limits(1):
        fit = adjust_densely(stretch, stamps_s)
        bundle = replace(stretch.bundle, world_from_vehicle=fit.world_from_vehicle, xyz_m=fit.xyz_m)
        stretch = replace(stretch, bundle=bundle)
        return {
            item.name: adjust_densely(convert_readings(stretch, item.from_recorded), stamps_s, fit.cost).cost - fit.cost
            for item in candidates
        }


def compare_all(solution: Solution, candidates: list[ReadingConvention]) -> dict[str, float]:
    """Solve all frames under each convention; return by name how much its cost exceeds that as recorded.

    Args:
        solution: poses and points at the optimum.
        candidates: conventions to try.
    """

    def cost(other: Solution) -> float:
        bundle = adjust_bundle(other.problem, other.bundle.world_from_vehicle, other.bundle.xyz_m)
        return float(bundle.measured.error(bundle.values))

    recorded = cost(solution)
    return {item.name: cost(convert_readings(solution, item.from_recorded)) - recorded for item in candidates}


def convert_readings(solution: Solution, from_recorded: FloatArray) -> Solution:
    """Return a solution with converted readings and the poses that they state; points move with a frame that sees them.

    Args:
        solution: of the readings as recorded.
        from_recorded: (3, 3) matrix from the recorded z_m, roll_rad and pitch_rad.
    """
    sensors, bundle, tracks = solution.problem.sensors, solution.bundle, solution.tracks
    readings = sensors.z_roll_pitch @ from_recorded.T
    sigma = np.where(np.isfinite(sensors.z_roll_pitch_sigma), sensors.z_roll_pitch_sigma, 0.0) @ np.abs(from_recorded).T
    z_m, roll_rad, pitch_rad = readings.T
    angles_rad = np.stack([heading(bundle.world_from_vehicle), pitch_rad, roll_rad], axis=1)
    positions_m = np.column_stack([bundle.world_from_vehicle[:, :2, 3], z_m])
    poses = make_pose(positions_m, Rotation.from_euler("ZYX", angles_rad))
    points = bundle.xyz_m.copy()
    used = np.flatnonzero(solution.observed)
    track, begin, views = np.unique(tracks.track[used], return_index=True, return_counts=True)
    middle = tracks.frame[used[begin + views // 2]]
    points[track] = transform(poses[middle], transform(invert(bundle.world_from_vehicle)[middle], points[track]))
    sensors = replace(
        sensors, first_pose=poses[0], z_roll_pitch=readings, z_roll_pitch_sigma=np.where(sigma > 0, sigma, np.inf)
    )
    return replace(
        solution,
        problem=replace(solution.problem, sensors=sensors),
        bundle=replace(bundle, world_from_vehicle=poses, xyz_m=points),
    )


def _candidates(vehicle_from_sonar: FloatArray) -> list[ReadingConvention]:
    """Return the conventions to try; those with all signs reversed count as others where the sonar is not level."""
    if np.abs(vehicle_from_sonar[2, :2]).max() < LEVEL_TOLERANCE:
        return list(CONVENTIONS)
    alone = [replace(item, mirrored="") for item in CONVENTIONS]
    negated = [ReadingConvention(item.mirrored, -item.from_recorded, "") for item in CONVENTIONS]
    return [*alone, *negated, ReadingConvention("z_m, roll_rad and pitch_rad negated", -np.eye(3), "")]


def _changes(solution: Solution, convention: ReadingConvention) -> bool:
    """Tell whether a convention changes the readings by more than their noise, and could be theirs."""
    sensors, matrix = solution.problem.sensors, convention.from_recorded
    change = np.abs(sensors.z_roll_pitch @ matrix.T - sensors.z_roll_pitch) / sensors.z_roll_pitch_sigma
    in_degrees = abs(np.linalg.det(matrix)) < 1
    spread_rad = np.std(sensors.z_roll_pitch[:, 1:], axis=0).max()
    return bool(change.max() > MIN_CHANGE_SIGMAS and (not in_degrees or spread_rad > MIN_SPREAD_RAD))
