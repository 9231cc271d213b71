"""The bound of a run on a simulated sequence: how good its poses could be if features were ideal.

It is the same graph solved with true associations, and with measurements projected from the true points plus the
front-end's own measured noise, independent from one observation to the next. ATE / bound is 1 for a run that no better
association could improve.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from asfm.config import Config
from asfm.errors import AsfmError
from asfm.evaluation.pose_error_table import SE3_ALIGNED, EvaluationRow, EvaluationTable
from asfm.evaluation.trajectory import absolute_errors, align_se3, associate
from asfm.evaluation.true_points import TruePoints, find_true_points, measure_noise
from asfm.geometry.feature_noise import feature_sigma
from asfm.geometry.poses import interpolate, invert, transform
from asfm.geometry.sonar import SonarModel
from asfm.navigation.frame_navigation import read_navigation
from asfm.sequence import Sequence
from asfm.types import BoolArray, FloatArray, FrameTruth, Tracks, Trajectory

BOUND = f"bound (true associations, ideal points), {SE3_ALIGNED}"
ATE_OVER_BOUND = f"ATE / bound, {SE3_ALIGNED}"
RANGE_NOISE = "noise of the front-end's ranges"
BEARING_NOISE = "noise of the front-end's bearings"
DRAWS = 3
"""How often the noise is drawn."""
SETTLED = 1e-5
"""Relative change of the cost at the optimum. A run stops earlier; in a graph that starts from the truth that would
leave weakly observed directions where they are, which is better than the data allow."""
LEAST_SHARE = 0.01
"""An observation's noise is at least this share of a pixel: a graph cannot hold exact measurements."""


@dataclass(frozen=True)
class Bound:
    """What ideal features would reach."""

    ate_m: float
    """RMSE after SE(3) alignment, scale off; root mean square over the draws of the noise."""
    sigma: FloatArray
    """(2,) standard deviations of range_m and bearing_rad that the front-end's observations have."""
    tracks: int
    """Tracks whose true point is known."""
    observations: int
    """Observations of those tracks that the run used."""


def measure_bound(
    sequence: Sequence,
    read_truth: Callable[[int], FrameTruth],
    tracks: Tracks,
    observed: BoolArray,
    config: Config,
    draws: int = DRAWS,
) -> Bound:
    """Measure the bound of a run.

    The graph is solved from the true poses and points, so that the bound is a property of the data and not of a start,
    and with every observation, as none is wrong. Without a single one it is what the other sensors reach.

    Args:
        sequence: gives the sonar, the sensors and the true poses.
        read_truth: gives the true elevations of a frame.
        tracks: (O,) what the front-end observed.
        observed: (O,) which of them entered the run's final graph.
        config: of the run; its seed draws the noise.
        draws: how often the noise is drawn.

    Raises:
        AsfmError: the sequence has no true poses, or the truth of a frame cannot be read.
    """
    if sequence.groundtruth is None:
        raise AsfmError(f"{sequence.name}: expected true poses to measure the bound with, found none")
    groundtruth = sequence.groundtruth
    world_from_vehicle = interpolate(groundtruth.timestamps_s, groundtruth.world_from_vehicle, sequence.timestamps_s)
    used = tracks.select(observed)
    truth = find_true_points(used, sequence.sonar, invert(world_from_vehicle @ sequence.vehicle_from_sonar), read_truth)
    noise = measure_noise(used, truth)
    sigma = _floor_sigma(feature_sigma(sequence.sonar, config.noise) if noise is None else noise, sequence.sonar)
    exact = _make_exact(used, truth, sigma)
    rng = np.random.default_rng(config.seed)
    errors_m = []
    for _ in range(draws):
        jitter = rng.normal(size=(len(exact), 2)) * (0.0 if noise is None else noise)
        drawn = replace(exact, range_m=exact.range_m + jitter[:, 0], bearing_rad=exact.bearing_rad + jitter[:, 1])
        poses = _solve(drawn, truth.xyz_m[truth.known], sequence, world_from_vehicle, config, rng)
        pairs = associate(Trajectory(sequence.timestamps_s, poses), groundtruth)
        aligned = align_se3(pairs.estimate, pairs.reference) @ pairs.estimate
        errors_m.append(absolute_errors(aligned, pairs.reference)[0])
    return Bound(float(np.sqrt(np.mean(np.square(errors_m)))), sigma, exact.count, len(exact))


def add_bound(table: EvaluationTable, bound: Bound) -> EvaluationTable:
    """Add the bound, the run's ATE over it, and the noise that it rests on; raises KeyError without the ATE's row."""
    ate = table.row(f"ATE RMSE, {SE3_ALIGNED}")
    beside = ate.odometry if ate.ratio is not None else None
    ratio = bound.ate_m / beside if beside else None
    rows = [EvaluationRow(BOUND, bound.ate_m, "m", beside, ratio)]
    if bound.ate_m > 0:
        rows.append(EvaluationRow(ATE_OVER_BOUND, ate.value / bound.ate_m, ""))
    rows.append(EvaluationRow(RANGE_NOISE, float(bound.sigma[0]), "m"))
    rows.append(EvaluationRow(BEARING_NOISE, float(np.degrees(bound.sigma[1])), "deg"))
    return EvaluationTable(table.rows + tuple(rows), table.notes)


def _make_exact(tracks: Tracks, truth: TruePoints, sigma: FloatArray) -> Tracks:
    """Put every observation where its true point is seen; tracks without one are left out."""
    exact = replace(
        tracks, range_m=truth.range_m, bearing_rad=truth.bearing_rad, sigma=np.tile(sigma, (len(tracks), 1))
    )
    return exact.select(truth.known[tracks.track])


def _floor_sigma(sigma: FloatArray, sonar: SonarModel) -> FloatArray:
    return np.maximum(sigma, LEAST_SHARE * np.array([sonar.range_step_m, sonar.bearing_step_rad]))


def _solve(
    tracks: Tracks,
    xyz_m: FloatArray,
    sequence: Sequence,
    world_from_vehicle: FloatArray,
    config: Config,
    rng: np.random.Generator,
) -> FloatArray:
    """Adjust the run's graph over ideal tracks, from true (N, 4, 4) poses and (T, 3) points.

    Returns:
        (N, 4, 4) in the start's world.
    """
    from asfm.backend.graph.bundle_adjustment import adjust_bundle  # loads GTSAM
    from asfm.backend.graph.problem import BundleProblem
    from asfm.backend.initialisation.initial_poses import initialise_from_odometry, initialise_from_tracks

    assert tracks.sigma is not None
    navigation = read_navigation(sequence, config.backend)
    start = initialise_from_odometry(navigation, sequence)
    start = start or initialise_from_tracks(navigation, sequence, tracks, config, rng)
    start_from_true = start.world_from_vehicle[0] @ invert(world_from_vehicle[0])
    problem = BundleProblem(
        tracks=tracks,
        observed=np.ones(len(tracks), dtype=bool),
        sigma=tracks.sigma,
        sensors=start.sensors,
        vehicle_from_sonar=sequence.vehicle_from_sonar,
        half_aperture_rad=sequence.sonar.elevation_aperture_rad / 2,
    )
    points = transform(start_from_true, xyz_m)
    return adjust_bundle(problem, start_from_true @ world_from_vehicle, points, SETTLED).world_from_vehicle
