"""The images as a witness of motion: where odometry's steps put matched points, and where the images show them.

Matches of near frames are judged by the planar motion that most agree with, which knows nothing of odometry. What
agrees is then held against odometry as it is and against the ways in which odometry is usually wrong: an axis
mirrored, the heading mirrored, a frame turned by a quarter, the lever arm forgotten.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.geometry.planar_motion import estimate_planar_motion_msac
from asfm.geometry.poses import heading, invert, make_pose, transform, wrap_angle
from asfm.geometry.sonar import SonarModel, project
from asfm.types import FloatArray, Keypoints, Matches

GAPS = (1, 2, 4)
"""Frames apart at which pairs are looked at: the farther, the clearer the motion and the fewer the matches."""
BY_PREDICTION = "arc"
"""Name of the filter that needs predicted poses: what it rejects may be right where the prediction is wrong."""
MIN_AGREEING = 8
"""Fewest matches that must agree on a planar motion."""
MAX_PAIRS = 60
"""Pairs of frames that are asked, spread over the sequence."""
MAX_POINTS = 60
"""Points of a pair that are looked at."""
TRIALS = 100
ELEVATIONS = 9
GIVEN = "as it is"


@dataclass(frozen=True)
class PointPairs:
    """Points that two frames share, as the images alone tell."""

    frame_a: int
    frame_b: int
    pixel_a: FloatArray
    """(M, 2) range_m and bearing_rad."""
    pixel_b: FloatArray
    """(M, 2) range_m and bearing_rad."""
    a_from_b: FloatArray
    """(4, 4) planar motion of the sonar that they agree on; of use where they have agreed."""


def collect_point_pairs(keypoints: Sequence[Keypoints], candidates: Iterable[Matches]) -> list[PointPairs]:
    """Gather the points that near frames share, those included that only a prediction of the poses has rejected."""
    pixels = {}
    point_pairs = []
    for matches in candidates:
        if matches.frame_b - matches.frame_a not in GAPS:
            continue
        for frame in (matches.frame_a, matches.frame_b):
            if frame not in pixels:
                pixels[frame] = keypoints[frame].range_bearing
        index = matches.index
        if BY_PREDICTION in matches.filters:
            index = np.concatenate(
                [index, matches.rejected[matches.rejected_by == matches.filters.index(BY_PREDICTION)]]
            )
        a, b = pixels[matches.frame_a][index[:, 0]], pixels[matches.frame_b][index[:, 1]]
        point_pairs.append(PointPairs(matches.frame_a, matches.frame_b, a, b, np.eye(4)))
    return point_pairs


def planar_inliers(pairs: Iterable[PointPairs], rng: np.random.Generator) -> list[PointPairs]:
    """Keep of each pair's points those that agree on a planar motion; pairs of too few are left out."""
    pairs = [pair for pair in pairs if len(pair.pixel_a) >= MIN_AGREEING]
    chosen = np.unique(np.linspace(0, len(pairs) - 1, min(len(pairs), MAX_PAIRS)).round().astype(int))
    agreed = []
    for pair in (pairs[index] for index in chosen.tolist()):
        xy_a, xy_b = (
            np.stack([pixel[:, 0] * np.cos(pixel[:, 1]), pixel[:, 0] * np.sin(pixel[:, 1])], axis=1)
            for pixel in (pair.pixel_a, pair.pixel_b)
        )
        first = rng.integers(0, len(xy_a), TRIALS)
        second = (first + rng.integers(1, len(xy_a), TRIALS)) % len(xy_a)
        picks = np.stack([first, second], axis=1)
        motion, agrees = estimate_planar_motion_msac(xy_a, xy_b, 0.03 * pair.pixel_b[:, 0], picks)
        if agrees.sum() >= max(MIN_AGREEING, 0.25 * len(agrees)):
            which = rng.permutation(np.flatnonzero(agrees))[:MAX_POINTS]
            agreed.append(PointPairs(pair.frame_a, pair.frame_b, pair.pixel_a[which], pair.pixel_b[which], motion))
    return agreed


def odometry_hypotheses(world_from_vehicle: FloatArray, vehicle_from_sonar: FloatArray) -> dict[str, FloatArray]:
    """List world_from_vehicle, (N, 4, 4), as it would be without each of the usual faults, by the fault's name."""
    place, rotation = world_from_vehicle[:, :3, 3], Rotation.from_matrix(world_from_vehicle[:, :3, :3])
    proposals = {GIVEN: world_from_vehicle}
    for axis, name in enumerate("xyz"):
        proposals[f"with its {name} axis mirrored"] = make_pose(place * np.where(np.arange(3) == axis, -1, 1), rotation)
    turned = Rotation.from_rotvec(np.outer(-2 * heading(world_from_vehicle), [0.0, 0.0, 1.0])) * rotation
    proposals["with its heading mirrored"] = make_pose(place, turned)
    left = np.diag([1.0, -1.0, 1.0, 1.0])
    proposals["with port and starboard swapped"] = left @ world_from_vehicle @ left
    proposals["inverted"] = invert(world_from_vehicle)
    for degrees in (90, 180, -90):
        turn = make_pose(np.zeros(3), Rotation.from_euler("z", degrees, degrees=True))
        proposals[f"with its body axes turned by {degrees} deg about z"] = world_from_vehicle @ turn
    if not np.allclose(vehicle_from_sonar, np.eye(4)):
        proposals["taken as that of the sonar, without the lever arm"] = world_from_vehicle @ invert(vehicle_from_sonar)
    return proposals


def median_arc_distance_m(pair: PointPairs, world_from_sonar: FloatArray, sonar: SonarModel) -> float:
    """Give the median distance in metres of a pair's points from the elevation arcs that the poses, (N, 4, 4), put them
    on; along the range, and across by the bearing at that range.
    """
    b_from_a = invert(world_from_sonar[pair.frame_b]) @ world_from_sonar[pair.frame_a]
    arcs = transform(b_from_a, sonar.elevation_arc(pair.pixel_a[:, 0], pair.pixel_a[:, 1], ELEVATIONS))
    range_m, bearing_rad, _ = project(arcs)
    seen_m, seen_rad = pair.pixel_b[:, :1], pair.pixel_b[:, 1:]
    turn_rad = wrap_angle(bearing_rad - seen_rad)
    return float(np.median(np.hypot(range_m - seen_m, seen_m * turn_rad).min(axis=1)))


def expected_arc_distance_m(pair: PointPairs, feature_sigma: FloatArray, step_sigma: FloatArray) -> float:
    """Give the distance in metres that noise alone would make, one sigma.

    Args:
        feature_sigma: (2,) standard deviations of range_m and bearing_rad.
        step_sigma: (N - 1, 2) standard deviations of the steps' rotation in rad and translation in m.
    """
    range_m = float(np.median(pair.pixel_b[:, 0]))
    first, last = sorted((pair.frame_a, pair.frame_b))
    turn_rad, shift_m = np.sqrt(np.sum(step_sigma[first:last] ** 2, axis=0))
    of_features = np.sqrt(2.0) * np.array([feature_sigma[0], range_m * feature_sigma[1]])
    return float(np.sqrt(np.sum(of_features**2) + 2 * shift_m**2 + (range_m * turn_rad) ** 2))
