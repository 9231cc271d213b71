"""Planar-motion inliers of near frame pairs, and their arc distance under hypotheses of odometry faults.

Matches of near frames are reduced to the inliers of a planar motion, which does not depend on odometry. Their distance
from the elevation arcs is then measured under the odometry as recorded and under hypotheses of common faults: an
axis or the heading mirrored, another convention of axes, poses, rotations or quaternions, or a missing lever arm.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.geometry.planar_motion import estimate_planar_motion_msac
from asfm.geometry.poses import heading, invert, make_pose, transform, wrap_angle
from asfm.geometry.sonar import SonarModel, project
from asfm.types import FloatArray, Keypoints, Matches

FRAME_GAPS = (1, 2, 4)
"""Gaps of the frame pairs that are tested: wider ones show the motion more clearly, but have fewer matches."""
PREDICTION_FILTER = "arc"
"""Filter that uses predicted poses: the matches that it rejects are kept here, because the prediction is tested."""
MIN_INLIERS = 8
MIN_INLIER_SHARE = 0.25
"""A frame pair is used when a planar motion has at least this many inliers, and this share of its matches."""
TOLERANCE_PER_RANGE = 0.03
"""Distance of an inlier from the planar motion, over its range."""
MAX_FRAME_PAIRS = 60
"""Frame pairs that are used by default, spread evenly over the sequence."""
MAX_POINTS = 60
"""Points of a frame pair that are used."""
RANSAC_TRIALS = 100
ARC_POINTS = 9
MARINE = "taken as NED/FRD (world z down, y to starboard)"
MARINE_AXES = np.diag([1.0, -1.0, -1.0, 1.0])
TURNED = "with its body axes (or the mounting of the sonar) turned by"
AS_RECORDED = "as it is"
"""Name of the hypothesis that the odometry has no fault."""


@dataclass(frozen=True, eq=False)
class PointPairs:
    """Points matched between two frames without the use of odometry."""

    frame_a: int
    frame_b: int
    range_bearing_a: FloatArray
    """(M, 2) range_m and bearing_rad in frame a."""
    range_bearing_b: FloatArray
    """(M, 2) range_m and bearing_rad in frame b."""
    a_from_b: FloatArray
    """(4, 4) planar motion of the sonar whose inliers the points are; the identity before it is estimated."""


def collect_point_pairs(keypoints: Sequence[Keypoints], candidates: Iterable[Matches]) -> list[PointPairs]:
    """Collect the matched points of near frames, including those that only the pose prediction rejected.

    Args:
        keypoints: those of every frame.
        candidates: matches of pairs of frames; only those with a gap in :data:`FRAME_GAPS` are used.
    """
    range_bearing = {}
    point_pairs = []
    for matches in candidates:
        if matches.frame_b - matches.frame_a not in FRAME_GAPS:
            continue
        for frame in (matches.frame_a, matches.frame_b):
            if frame not in range_bearing:
                range_bearing[frame] = keypoints[frame].range_bearing
        index = matches.index
        if PREDICTION_FILTER in matches.filters:
            by_prediction = matches.rejected_by == matches.filters.index(PREDICTION_FILTER)
            index = np.concatenate([index, matches.rejected[by_prediction]])
        a, b = range_bearing[matches.frame_a][index[:, 0]], range_bearing[matches.frame_b][index[:, 1]]
        point_pairs.append(PointPairs(matches.frame_a, matches.frame_b, a, b, np.eye(4)))
    return point_pairs


def planar_inliers(
    pairs: Iterable[PointPairs], rng: np.random.Generator, max_pairs: int = MAX_FRAME_PAIRS
) -> list[PointPairs]:
    """Reduce each frame pair to the inliers of a planar motion; pairs with too few are dropped.

    Args:
        pairs: matched points of frame pairs.
        rng: draws the RANSAC samples and the points that are kept.
        max_pairs: number of frame pairs that are used, spread evenly over those with enough points.
    """
    pairs = [pair for pair in pairs if len(pair.range_bearing_a) >= MIN_INLIERS]
    chosen = np.unique(np.linspace(0, len(pairs) - 1, min(len(pairs), max_pairs)).round().astype(int))
    reduced = []
    for pair in (pairs[index] for index in chosen.tolist()):
        xy_a, xy_b = (
            np.stack([polar[:, 0] * np.cos(polar[:, 1]), polar[:, 0] * np.sin(polar[:, 1])], axis=1)
            for polar in (pair.range_bearing_a, pair.range_bearing_b)
        )
        first = rng.integers(0, len(xy_a), RANSAC_TRIALS)
        second = (first + rng.integers(1, len(xy_a), RANSAC_TRIALS)) % len(xy_a)
        picks = np.stack([first, second], axis=1)
        tolerance_m = TOLERANCE_PER_RANGE * pair.range_bearing_b[:, 0]
        motion, inlier = estimate_planar_motion_msac(xy_a, xy_b, tolerance_m, picks)
        if inlier.sum() >= max(MIN_INLIERS, MIN_INLIER_SHARE * len(inlier)):
            kept = rng.permutation(np.flatnonzero(inlier))[:MAX_POINTS]
            a, b = pair.range_bearing_a[kept], pair.range_bearing_b[kept]
            reduced.append(PointPairs(pair.frame_a, pair.frame_b, a, b, motion))
    return reduced


def to_marine_axes(world_from_vehicle: FloatArray) -> FloatArray:
    """Turn the axes of world and vehicle of (N, 4, 4) poses by 180 deg about x: z up and y to port <-> NED/FRD."""
    return np.asarray(MARINE_AXES @ world_from_vehicle @ MARINE_AXES)


def odometry_hypotheses(world_from_vehicle: FloatArray, vehicle_from_sonar: FloatArray) -> dict[str, FloatArray]:
    """Return the odometry as recorded and with each common fault undone.

    Args:
        world_from_vehicle: (N, 4, 4) odometry.
        vehicle_from_sonar: (4, 4) lever arm.

    Returns:
        (N, 4, 4) world_from_vehicle by the name of the fault, commonest first.
    """
    position, rotation = world_from_vehicle[:, :3, 3], Rotation.from_matrix(world_from_vehicle[:, :3, :3])
    hypotheses = {AS_RECORDED: world_from_vehicle}
    for axis, name in enumerate("xyz"):
        mirrored = position * np.where(np.arange(3) == axis, -1, 1)
        hypotheses[f"with its {name} axis mirrored"] = make_pose(mirrored, rotation)
    turned = Rotation.from_rotvec(np.outer(-2 * heading(world_from_vehicle), [0.0, 0.0, 1.0])) * rotation
    hypotheses["with its heading mirrored"] = make_pose(position, turned)
    mirror_y = np.diag([1.0, -1.0, 1.0, 1.0])
    hypotheses["with port and starboard swapped"] = mirror_y @ world_from_vehicle @ mirror_y
    hypotheses["inverted"] = invert(world_from_vehicle)
    hypotheses["with its rotations inverted"] = make_pose(position, rotation.inv())
    w_first = Rotation.from_quat(rotation.as_quat()[:, [1, 2, 3, 0]])
    hypotheses["with its quaternions read as x y z w where w comes first"] = make_pose(position, w_first)
    hypotheses[MARINE] = to_marine_axes(world_from_vehicle)
    for degrees in (90, 180, -90):
        turn = make_pose(np.zeros(3), Rotation.from_euler("z", degrees, degrees=True))
        hypotheses[f"{TURNED} {degrees} deg about z"] = world_from_vehicle @ turn
    if not np.allclose(vehicle_from_sonar, np.eye(4)):
        of_sonar = world_from_vehicle @ invert(vehicle_from_sonar)
        hypotheses["taken as that of the sonar, without the lever arm"] = of_sonar
    return hypotheses


def median_arc_distance_m(pair: PointPairs, world_from_sonar: FloatArray, sonar: SonarModel) -> float:
    """Return the median distance of a pair's points in frame b from the elevation arcs of its points in frame a.

    The distance is taken along the range, and across it by the bearing at that range.

    Args:
        pair: matched points of two frames.
        world_from_sonar: (N, 4, 4) poses.
        sonar: gives the elevation aperture.
    """
    b_from_a = invert(world_from_sonar[pair.frame_b]) @ world_from_sonar[pair.frame_a]
    range_m, bearing_rad, _ = project(transform(b_from_a, _elevation_arcs_m(pair, sonar)))
    measured_m, measured_rad = pair.range_bearing_b[:, :1], pair.range_bearing_b[:, 1:]
    difference_rad = wrap_angle(bearing_rad - measured_rad)
    return float(np.median(np.hypot(range_m - measured_m, measured_m * difference_rad).min(axis=1)))


@lru_cache(maxsize=4 * MAX_FRAME_PAIRS)
def _elevation_arcs_m(pair: PointPairs, sonar: SonarModel) -> FloatArray:
    """Return the (M, ARC_POINTS, 3) arcs of a pair's points in frame a, which all hypotheses share."""
    return sonar.elevation_arc(pair.range_bearing_a[:, 0], pair.range_bearing_a[:, 1], ARC_POINTS)


def expected_arc_distance_m(pair: PointPairs, feature_sigma: FloatArray, step_sigma: FloatArray) -> float:
    """Return the standard deviation in metres of the arc distance under noise alone.

    Args:
        pair: matched points of two frames.
        feature_sigma: (2,) standard deviations of range_m and bearing_rad.
        step_sigma: (N - 1, 2) standard deviations of the steps' rotation in rad and translation in m.
    """
    range_m = float(np.median(pair.range_bearing_b[:, 0]))
    first, last = sorted((pair.frame_a, pair.frame_b))
    turn_rad, shift_m = np.sqrt(np.sum(step_sigma[first:last] ** 2, axis=0))
    of_features = np.sqrt(2.0) * np.array([feature_sigma[0], range_m * feature_sigma[1]])
    return float(np.sqrt(np.sum(of_features**2) + 2 * shift_m**2 + (range_m * turn_rad) ** 2))
