"""Summary of a solution: landmarks, covariances and diagnostics of a reconstruction."""

from dataclasses import replace

from asfm.backend.ambiguity.mirror_ambiguity import find_mirror, inflate_for_mirror, warn_of_mirror
from asfm.backend.diagnostics.connectivity import warn_of_disconnected_steps
from asfm.backend.diagnostics.inconsistency import (
    measure_consistency,
    warn_of_inconsistency,
    withdraw_well_constrained,
)
from asfm.backend.diagnostics.local_fit import measure_local_fit, warn_of_poor_fit
from asfm.backend.diagnostics.observability import SPAN, warn_of_unreliable_poses
from asfm.backend.diagnostics.reading_conventions import diagnose_conventions
from asfm.backend.estimation.landmarks import describe_landmarks
from asfm.backend.estimation.solution import Solution
from asfm.backend.graph.marginal_covariance import measure_uncertainty
from asfm.backend.graph.schur_complement import marginalise_points
from asfm.config import Config
from asfm.diagnostics import Diagnostic
from asfm.sequence import Sequence
from asfm.stages import StageClock
from asfm.types import Reconstruction, Trajectory


def summarise(
    sequence: Sequence,
    solution: Solution,
    config: Config,
    clock: StageClock,
    diagnostics: tuple[Diagnostic, ...] = (),
) -> Reconstruction:
    """Summarise a solution: landmarks with covariances, covariances of the poses, and diagnostics.

    Args:
        sequence: the one that the solution is of.
        solution: poses and points at the optimum.
        config: sections ``backend`` and ``tracks``.
        clock: times the stage.
        diagnostics: those found before; the solution's own are added.
    """
    with clock.stage("conventions"):
        conventions = diagnose_conventions(solution, sequence.timestamps_s)
    with clock.stage("landmarks") as report:
        span, information = min(SPAN, len(sequence) - 1), marginalise_points(solution.bundle)
        uncertainty = measure_uncertainty(solution.bundle, solution.elevation_information_ratio, span, information)
        consistency = measure_consistency(solution, sequence.timestamps_s, information, config.backend.max_views)
        if not solution.problem.sensors.measured:
            consistency = replace(consistency, local_fit=measure_local_fit(solution))
        poor_fit = warn_of_poor_fit(consistency.local_fit)
        mirror = find_mirror(solution, config.backend.scene)
        stated = inflate_for_mirror(uncertainty, solution, mirror)
        landmarks = describe_landmarks(solution, stated.point_m2, sequence, config)
        landmarks = withdraw_well_constrained(landmarks, consistency, bool(conventions or poor_fit))
        report.counts = {"landmarks": len(landmarks), "well constrained": int(landmarks.well_constrained.sum())}
    return Reconstruction(
        trajectory=Trajectory(sequence.timestamps_s, solution.bundle.world_from_vehicle),
        tracks=solution.tracks,
        observed=solution.observed,
        landmarks=landmarks,
        pose_covariance=stated.pose,
        diagnostics=(
            *diagnostics,
            *warn_of_disconnected_steps(sequence, solution, config),
            *poor_fit,
            *warn_of_mirror(uncertainty, solution.bundle, mirror),
            *warn_of_unreliable_poses(solution, uncertainty),
            *warn_of_inconsistency(consistency),
            *conventions,
        ),
        consistency=consistency,
    )
