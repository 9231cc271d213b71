"""How well a trajectory agrees with points that somebody tracked by hand: a measure that needs no true poses."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from asfm.geometry.poses import interpolate, invert, transform
from asfm.geometry.sonar import SonarModel, project
from asfm.types import BoolArray, FloatArray, HandTracks, Trajectory

MIN_VIEWS = 3
"""Two observations have four numbers for three unknowns: next to nothing is left over to disagree."""
START_ELEVATIONS = 15
"""Elevations of the first arc that are tried as a start."""


@dataclass(frozen=True)
class HandTrackResiduals:
    """What is left of the hand-tracked points after each is placed where it fits all its observations best."""

    range_rmse_m: float
    bearing_rmse_rad: float
    observations: int
    landmarks: int


def measure_hand_tracks(
    hand_tracks: HandTracks, trajectory: Trajectory, sonar: SonarModel, vehicle_from_sonar: FloatArray
) -> HandTrackResiduals | None:
    """Triangulate every hand-tracked point with the trajectory's poses and give the residuals.

    Ranges and bearings are weighed by the size of the sonar's pixels. Observations outside the trajectory's time, and
    points with fewer than three of the others, are left out; None where nothing remains.
    """
    if len(trajectory.timestamps_s) == 0:
        return None
    at_s = hand_tracks.timestamps_s
    inside = (at_s >= trajectory.timestamps_s[0]) & (at_s <= trajectory.timestamps_s[-1])
    world_from_vehicle = interpolate(trajectory.timestamps_s, trajectory.world_from_vehicle, at_s)
    sonar_from_world = invert(world_from_vehicle @ vehicle_from_sonar)
    chosen = (_choose(hand_tracks, inside, landmark) for landmark in np.unique(hand_tracks.landmark))
    residuals = [
        _fit_landmark(hand_tracks.range_m[views], hand_tracks.bearing_rad[views], sonar_from_world[views], sonar)
        for views in chosen
        if views.sum() >= MIN_VIEWS
    ]
    if not residuals:
        return None
    range_px, bearing_px = np.concatenate(residuals, axis=1)
    return HandTrackResiduals(
        range_rmse_m=float(np.sqrt(np.mean(range_px**2)) * sonar.range_step_m),
        bearing_rmse_rad=float(np.sqrt(np.mean(bearing_px**2)) * sonar.bearing_step_rad),
        observations=len(range_px),
        landmarks=len(residuals),
    )


def _choose(hand_tracks: HandTracks, inside: BoolArray, landmark: int) -> BoolArray:
    return np.asarray((hand_tracks.landmark == landmark) & inside)


def _fit_landmark(
    range_m: FloatArray, bearing_rad: FloatArray, sonar_from_world: FloatArray, sonar: SonarModel
) -> FloatArray:
    """Place one point by least squares; returns its (2, V) residuals in pixels, ranges then bearings."""

    def residuals(xyz_m: FloatArray) -> FloatArray:
        seen_range_m, seen_bearing_rad, _ = project(transform(sonar_from_world, xyz_m))
        turn_rad = np.remainder(seen_bearing_rad - bearing_rad + np.pi, 2 * np.pi) - np.pi
        return np.concatenate([(seen_range_m - range_m) / sonar.range_step_m, turn_rad / sonar.bearing_step_rad])

    arc_m = sonar.elevation_arc(range_m[0], bearing_rad[0], START_ELEVATIONS)
    starts_m = transform(invert(sonar_from_world[0]), arc_m)
    start_m = min(starts_m, key=lambda xyz_m: float(np.square(residuals(xyz_m)).sum()))
    return np.asarray(least_squares(residuals, start_m, method="lm").fun).reshape(2, -1)
