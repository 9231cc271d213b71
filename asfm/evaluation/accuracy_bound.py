"""Lower bound of the pose error on a simulated sequence: the same graph with true associations and ideal features.

Observations are projected from the true points, plus the front-end's own measured noise, drawn independently for each
observation. ATE / bound is 1 for a run that no better association could improve.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from asfm.config import Config
from asfm.evaluation.association import associate
from asfm.evaluation.evaluation_table import EvaluationRow, EvaluationTable
from asfm.evaluation.pose_error_table import ATE_RMSE, SE3_ALIGNED
from asfm.evaluation.trajectory import absolute_errors, align_se3, interpolate_groundtruth
from asfm.evaluation.true_points import TruePoints, find_true_points, measure_noise
from asfm.geometry.feature_noise import feature_sigma
from asfm.geometry.poses import invert, transform
from asfm.geometry.sonar import SonarModel
from asfm.navigation.frame_navigation import read_navigation
from asfm.sequence import Sequence
from asfm.types import BoolArray, FloatArray, FrameTruth, Tracks, Trajectory

BOUND_ATE = "bound_ate_rmse_m_se3"
"""Key of the bound, RMSE after SE(3) alignment."""
DRAWS = 3
"""Draws of the noise over which the bound is averaged."""
RELATIVE_COST_TOLERANCE = 1e-5
"""Relative change of the cost at the optimum. The pipeline stops earlier; in a graph initialised at the truth that
would leave weakly observed directions at their true values, better than the data allow."""
MIN_SIGMA_PX = 0.01
"""Smallest noise of an observation in pixels: a graph cannot hold exact measurements."""


@dataclass(frozen=True)
class Bound:
    """Pose error that ideal features would reach."""

    ate_m: float
    """RMSE after SE(3) alignment, scale off; root mean square over the draws of the noise."""
    sigma: FloatArray
    """(2,) standard deviations of range_m and bearing_rad of the front-end's observations."""
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

    The graph is initialised at the true poses and points, so that the bound is a property of the data and not of an
    initialisation, and holds every observation, as none is wrong. Without observations it is the error of the other
    sensors.

    Args:
        sequence: sonar, sensors and true poses.
        read_truth: returns the true elevations of a frame.
        tracks: (O,) the front-end's observations.
        observed: (O,) those that entered the run's final graph.
        config: of the run; its seed draws the noise.
        draws: number of draws of the noise.

    Raises:
        AsfmError: the sequence has no true poses, or the truth of a frame cannot be read.
    """
    world_from_vehicle = interpolate_groundtruth(sequence)
    used = tracks.select(observed)
    truth = find_true_points(used, sequence.sonar, invert(world_from_vehicle @ sequence.vehicle_from_sonar), read_truth)
    noise = measure_noise(used, truth)
    sigma = _limit_sigma(feature_sigma(sequence.sonar, config.noise) if noise is None else noise, sequence.sonar)
    exact = _make_exact(used, truth, sigma)
    xyz_m, rng = truth.xyz_m[truth.known], np.random.default_rng(config.seed)
    errors_m = []
    for _ in range(draws):
        drawn = _add_noise(exact, np.zeros(2) if noise is None else noise, rng)
        errors_m.append(
            _translation_errors_m(_solve(drawn, xyz_m, sequence, world_from_vehicle, config, rng), sequence)
        )
    return Bound(float(np.sqrt(np.mean(np.square(errors_m)))), sigma, exact.count, len(exact))


def add_bound(table: EvaluationTable, bound: Bound) -> EvaluationTable:
    """Add the bound, the run's ATE over the bound, and the noise that the bound is computed with.

    Raises:
        KeyError: the table has no ATE.
    """
    ate = table.row(ATE_RMSE)
    odometry_m = ate.odometry if ate.ratio is not None else None
    ratio = bound.ate_m / odometry_m if odometry_m else None
    name = f"bound (true associations, ideal points), {SE3_ALIGNED}"
    rows = [EvaluationRow(BOUND_ATE, name, bound.ate_m, "m", odometry_m, ratio)]
    if bound.ate_m > 0:
        rows.append(EvaluationRow("ate_over_bound", f"ATE / bound, {SE3_ALIGNED}", ate.value / bound.ate_m, ""))
    range_m, bearing_deg = float(bound.sigma[0]), float(np.degrees(bound.sigma[1]))
    rows.append(EvaluationRow("feature_range_sigma_m", "noise of the front-end's ranges", range_m, "m"))
    rows.append(EvaluationRow("feature_bearing_sigma_deg", "noise of the front-end's bearings", bearing_deg, "deg"))
    return EvaluationTable(table.rows + tuple(rows), table.notes)


def _make_exact(tracks: Tracks, truth: TruePoints, sigma: FloatArray) -> Tracks:
    """Move every observation to the projection of its true point; tracks without one are left out."""
    exact = replace(
        tracks, range_m=truth.range_m, bearing_rad=truth.bearing_rad, sigma=np.tile(sigma, (len(tracks), 1))
    )
    return exact.select(truth.known[tracks.track])


def _add_noise(tracks: Tracks, sigma: FloatArray, rng: np.random.Generator) -> Tracks:
    """Add Gaussian noise of (2,) standard deviations to range_m and bearing_rad."""
    noise = rng.normal(size=(len(tracks), 2)) * sigma
    return replace(tracks, range_m=tracks.range_m + noise[:, 0], bearing_rad=tracks.bearing_rad + noise[:, 1])


def _limit_sigma(sigma: FloatArray, sonar: SonarModel) -> FloatArray:
    return np.maximum(sigma, MIN_SIGMA_PX * np.array([sonar.range_step_m, sonar.bearing_step_rad]))


def _translation_errors_m(world_from_vehicle: FloatArray, sequence: Sequence) -> FloatArray:
    """Return the translation errors (N,) of (N, 4, 4) poses after SE(3) alignment."""
    assert sequence.groundtruth is not None
    pairs = associate(Trajectory(sequence.timestamps_s, world_from_vehicle), sequence.groundtruth)
    return absolute_errors(align_se3(pairs.estimate, pairs.reference) @ pairs.estimate, pairs.reference)[0]


def _solve(
    tracks: Tracks,
    xyz_m: FloatArray,
    sequence: Sequence,
    world_from_vehicle: FloatArray,
    config: Config,
    rng: np.random.Generator,
) -> FloatArray:
    """Adjust the run's graph over ideal tracks, initialised at the true (N, 4, 4) poses and (T, 3) points.

    Without odometry the motion prior is as wide as the true rotations, as the run widens its own at the end.

    Returns:
        (N, 4, 4) poses in the world of the run's initial poses.
    """
    from asfm.backend.ambiguity.motion_prior import widen_rotation_sigma  # loads GTSAM
    from asfm.backend.graph.bundle_adjustment import adjust_bundle
    from asfm.backend.graph.problem import BundleProblem
    from asfm.backend.initialisation.initial_poses import initialise_from_odometry, initialise_from_tracks

    assert tracks.sigma is not None
    navigation = read_navigation(sequence, config.backend)
    initial = initialise_from_odometry(navigation, sequence)
    initial = initial or initialise_from_tracks(navigation, sequence, tracks, config, rng)
    sensors = initial.sensors
    if not sensors.measured and len(sensors.steps):
        sensors = widen_rotation_sigma(sensors, world_from_vehicle)
    initial_from_true = initial.world_from_vehicle[0] @ invert(world_from_vehicle[0])
    problem = BundleProblem(
        tracks=tracks,
        observed=np.ones(len(tracks), dtype=bool),
        sigma=tracks.sigma,
        sensors=sensors,
        vehicle_from_sonar=sequence.vehicle_from_sonar,
        half_aperture_rad=sequence.sonar.elevation_aperture_rad / 2,
    )
    points = transform(initial_from_true, xyz_m)
    poses = initial_from_true @ world_from_vehicle
    return adjust_bundle(problem, poses, points, RELATIVE_COST_TOLERANCE).world_from_vehicle
