"""Image jumps: steps at which the images change abruptly while odometry moves on as before.

Frames that were lost, exchanged or sorted by name as text (1, 10, 11, 2) leave such steps.
"""

from collections.abc import Sequence as Rows

import numpy as np

from asfm.diagnostics import Diagnostic, format_runs, step_runs
from asfm.geometry.sonar import SonarModel
from asfm.navigation.odometry_hypotheses import (
    PointPairs,
    expected_arc_distance_m,
    median_arc_distance_m,
    planar_inliers,
)
from asfm.types import BoolArray, FloatArray, IntArray

JUMP_RATIO = 3.0
"""A step is a jump when its arc distance exceeds the expected one by this factor; that of right steps is below 2."""
USUAL_STEP_RATIO = 2.0
"""Odometry moves on as before where its step is at most this multiple of the median one."""
MIN_KEYPOINT_SHARE = 0.5
"""Images with fewer keypoints than this share of the median may have no motion in common with any other."""
MAX_RUN = 2
"""Longest run of jumps: an exchanged frame has one before and one after it; longer ones show nothing that matches."""


def find_image_jumps(
    world_from_sonar: FloatArray,
    step_sigma: FloatArray,
    pairs: Rows[PointPairs],
    keypoint_counts: IntArray,
    sonar: SonarModel,
    feature_sigma: FloatArray,
) -> BoolArray:
    """Find the steps at which the images jump and odometry does not.

    At a jump either the points lie far from where odometry puts them, or the images before and after it have no planar
    motion in common at all. The steps before and after it must be as odometry says. One step without matches is no jump
    where frames around it match; two are, because the frame between them then matches neither neighbour.

    Args:
        world_from_sonar: (N, 4, 4) odometry.
        step_sigma: (N - 1, 2) standard deviations of the steps' rotation in rad and translation in m.
        pairs: matched points of near frames.
        keypoint_counts: (N,) number of keypoints in each frame.
        sonar: gives the elevation aperture.
        feature_sigma: (2,) standard deviations of range_m and bearing_rad.

    Returns:
        (N - 1,) which steps are jumps.
    """
    count = len(world_from_sonar)
    right, wrong, bridged = (np.zeros(max(count - 1, 0), dtype=bool) for _ in range(3))
    rng = np.random.default_rng(0)
    for pair in planar_inliers([p for p in pairs if p.frame_b - p.frame_a == 1], rng, len(pairs)):
        expected_m = expected_arc_distance_m(pair, feature_sigma, step_sigma)
        far = median_arc_distance_m(pair, world_from_sonar, sonar) > JUMP_RATIO * expected_m
        (wrong if far else right)[pair.frame_a] = True
    missing = ~right & ~wrong
    wide = [p for p in pairs if p.frame_b - p.frame_a > 1 and missing[p.frame_a : p.frame_b].any()]
    for pair in planar_inliers(wide, rng, len(wide)):
        bridged[pair.frame_a : pair.frame_b] = True
    rich = keypoint_counts >= MIN_KEYPOINT_SHARE * np.median(keypoint_counts)
    shift_m = np.linalg.norm(np.diff(world_from_sonar[:, :3, 3], axis=0), axis=1)
    usual = shift_m <= USUAL_STEP_RATIO * np.median(shift_m) if count > 1 else right
    jumps = (wrong | missing) & rich[:-1] & rich[1:] & usual
    for first, last in step_runs(jumps):
        before, after = right[max(first - 1, 0) : first], right[last : last + 1]
        matched = last - first == 1 and bool((missing & bridged)[first])
        if matched or last - first > MAX_RUN or not (before.all() and after.all() and len(before) and len(after)):
            jumps[first:last] = False
    return np.asarray(jumps)


def diagnose_image_jumps(jumps: BoolArray) -> tuple[Diagnostic, ...]:
    """Report the steps (N - 1,) at which images jump."""
    if not jumps.any():
        return ()
    runs = step_runs(jumps)
    message = (
        f"the images jump at {int(jumps.sum())} of {len(jumps)} steps ({format_runs(runs)}), where odometry moves on "
        "as before: frames seem to be lost or in another order than their stamps say; check the order of the images"
    )
    return (Diagnostic("image-jumps", message, runs),)
