"""Reprojection error of hand-tracked points under a trajectory, which needs no true poses."""

from dataclasses import dataclass

import numpy as np

from asfm.evaluation.association import within_reach
from asfm.geometry.poses import interpolate, invert, transform, wrap_angle
from asfm.geometry.sonar import SonarModel, project
from asfm.types import FloatArray, HandTracks, Trajectory

MIN_VIEWS = 3
"""Observations of a point that is evaluated: two have four numbers for three unknowns, hardly any residual."""
INITIAL_ELEVATIONS = 15
"""Elevations on the first observation's arc that are tried as the initial point."""


@dataclass(frozen=True)
class HandTrackResiduals:
    """Residuals of hand-tracked points, each triangulated from all its observations."""

    range_rmse_m: float
    bearing_rmse_rad: float
    observations: int
    landmarks: int


def measure_hand_tracks(
    hand_tracks: HandTracks, trajectory: Trajectory, sonar: SonarModel, vehicle_from_sonar: FloatArray
) -> HandTrackResiduals | None:
    """Triangulate every hand-tracked point with the trajectory's poses and return the residuals.

    Ranges and bearings are weighted by the sonar's pixel size. Observations outside the trajectory's time, and points
    with fewer than three of the others, are left out.

    Args:
        hand_tracks: (O,) observations.
        trajectory: world_from_vehicle.
        sonar: pixel size and elevation aperture.
        vehicle_from_sonar: (4, 4) lever arm.

    Returns:
        The residuals over all observations used; None where none is left.
    """
    if len(trajectory.timestamps_s) == 0:
        return None
    at_s = hand_tracks.timestamps_s
    inside = within_reach(at_s, trajectory.timestamps_s)
    world_from_vehicle = interpolate(trajectory.timestamps_s, trajectory.world_from_vehicle, at_s)
    sonar_from_world = invert(world_from_vehicle @ vehicle_from_sonar)
    residuals = []
    for landmark in np.unique(hand_tracks.landmark):
        views = (hand_tracks.landmark == landmark) & inside
        if views.sum() >= MIN_VIEWS:
            range_m, bearing_rad = hand_tracks.range_m[views], hand_tracks.bearing_rad[views]
            residuals.append(_fit_landmark(range_m, bearing_rad, sonar_from_world[views], sonar))
    if not residuals:
        return None
    range_px, bearing_px = np.concatenate(residuals, axis=1)
    return HandTrackResiduals(
        range_rmse_m=float(np.sqrt(np.mean(range_px**2)) * sonar.range_step_m),
        bearing_rmse_rad=float(np.sqrt(np.mean(bearing_px**2)) * sonar.bearing_step_rad),
        observations=len(range_px),
        landmarks=len(residuals),
    )


def _fit_landmark(
    range_m: FloatArray, bearing_rad: FloatArray, sonar_from_world: FloatArray, sonar: SonarModel
) -> FloatArray:
    """Triangulate one point by least squares and return its (2, V) residuals in pixels, ranges then bearings."""
    from scipy.optimize import least_squares  # slow to load

    def residuals(xyz_m: FloatArray) -> FloatArray:
        expected_range_m, expected_bearing_rad, _ = project(transform(sonar_from_world, xyz_m))
        bearing_error_rad = wrap_angle(expected_bearing_rad - bearing_rad)
        return np.concatenate(
            [(expected_range_m - range_m) / sonar.range_step_m, bearing_error_rad / sonar.bearing_step_rad]
        )

    arc_m = sonar.elevation_arc(range_m[0], bearing_rad[0], INITIAL_ELEVATIONS)
    candidates_m = transform(invert(sonar_from_world[0]), arc_m)
    initial_m = min(candidates_m, key=lambda xyz_m: float(np.square(residuals(xyz_m)).sum()))
    return np.asarray(least_squares(residuals, initial_m, method="lm").fun).reshape(2, -1)
