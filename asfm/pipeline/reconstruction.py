"""Acoustic structure from motion from end to end, as the paper's block diagram."""

from dataclasses import dataclass, replace

import numpy as np

from asfm.backend.ambiguity.mirror_ambiguity import choose_mirror, find_mirror, inflate_for_mirror, warn_of_mirror
from asfm.backend.ambiguity.motion_prior import state_prior_covariance, widen_motion_prior
from asfm.backend.ambiguity.partial_mirroring import correct_partial_mirroring
from asfm.backend.diagnostics.connectivity import warn_of_disconnected_steps
from asfm.backend.diagnostics.observability import SPAN, warn_of_unreliable_poses
from asfm.backend.estimation.landmarks import describe_landmarks
from asfm.backend.estimation.solution import Solution, solve_tracks
from asfm.backend.graph.marginal_covariance import measure_uncertainty
from asfm.backend.initialisation.initial_poses import (
    InitialPoses,
    initialise_from_odometry,
    initialise_from_tracks,
    replace_unreliable_steps,
    verify_odometry,
)
from asfm.config import Config
from asfm.diagnostics import Diagnostic
from asfm.frontend.denoising.echo_mask import detect_echo_mask
from asfm.frontend.features.keypoints import cut_keypoint_patches, detect_keypoints
from asfm.frontend.matching.external_matches import ExternalMatches, filter_external_matches
from asfm.frontend.matching.pair_matching import match_with_previous
from asfm.frontend.matching.patch_alignment import align_matches
from asfm.frontend.tracking.association import associate
from asfm.frontend.tracking.guided_matching import add_matches, match_to_landmarks
from asfm.frontend.tracking.track_builder import build_tracks, share_changed
from asfm.frontend.tracking.triangulated_tracks import TriangulatedTracks
from asfm.geometry.elevation_arcs import PosePrediction
from asfm.navigation.duplicate_frames import drop_duplicate_frames
from asfm.navigation.odometry_hypotheses import collect_point_pairs
from asfm.pipeline.loop_closure import find_loops
from asfm.pipeline.self_calibration import apply_calibration, estimate_calibration
from asfm.prefetch import prefetch_map
from asfm.recorder import NullRecorder, Recorder
from asfm.sequence import Sequence
from asfm.stages import Progress, StageClock, StageReport, no_progress
from asfm.types import BoolArray, Frame, Keypoints, Matches, Reconstruction, Trajectory


@dataclass(frozen=True)
class Run:
    """A reconstruction and what it took."""

    reconstruction: Reconstruction
    stages: tuple[StageReport, ...]


def reconstruct(
    sequence: Sequence,
    config: Config,
    recorder: Recorder | None = None,
    progress: Progress = no_progress,
    given: ExternalMatches | None = None,
) -> Run:
    """Reconstruct trajectory and landmarks of a sequence.

    Images become keypoints and candidate matches once. Association and optimisation then alternate: better poses
    allow a better choice of matches, and that better poses.

    Args:
        sequence: frames and what navigation there is.
        config: every setting.
        recorder: shown each stage; nothing is shown without one.
        progress: told how far each stage is.
        given: keypoints and matches computed elsewhere, which take the place of asfm's own; no others are added.

    Raises:
        AsfmError: a frame cannot be read.
    """
    recorder = recorder or NullRecorder()
    clock = StageClock(progress)
    if given is not None:  # what somebody else's matches are worth shall show: loops and growth would be asfm's own
        loops = config.loops.model_copy(update={"enabled": False})
        config = config.model_copy(update={"loops": loops, "tracks": config.tracks.model_copy(update={"window": 0})})
    keypoints, candidates = extract_matches(sequence, config, recorder, clock, given)
    calibrated, solution, diagnostics = estimate(sequence, keypoints, candidates, config, clock)
    reconstruction = summarise(calibrated, solution, config, clock, diagnostics)
    with clock.stage("record"):
        recorder.record_reconstruction(calibrated, reconstruction)
    return Run(reconstruction, tuple(clock.reports))


def extract_matches(
    sequence: Sequence, config: Config, recorder: Recorder, clock: StageClock, given: ExternalMatches | None = None
) -> tuple[list[Keypoints], list[Matches]]:
    """Turn images into keypoints, and pairs of frames into candidate matches. Two images are in memory at a time."""

    def look(frame: Frame) -> tuple[Frame, BoolArray, Keypoints]:
        mask = detect_echo_mask(frame, config)
        if given is None:
            return frame, mask, detect_keypoints(frame, mask, sequence.sonar, config)
        return frame, mask, cut_keypoint_patches(frame, given.keypoints[frame.index], sequence.sonar, config)

    keypoints: list[Keypoints] = []
    candidates: list[Matches] = []
    predicted = predict_poses(sequence, config)
    longest_gap = config.matching.max_gap if given is None else given.longest_gap
    with clock.stage("front-end") as report:
        for frame, mask, found in prefetch_map(look, sequence):
            keypoints.append(found)
            if given is None:
                matches = match_with_previous(frame.index, keypoints, config, sequence.sonar, predicted)
            else:
                matches = filter_external_matches(given, frame.index, keypoints, config, sequence.sonar, predicted)
            matches = align_matches(matches, keypoints, sequence.sonar, config)
            candidates += matches
            recorder.record_frame(frame, mask, keypoints[-1])
            if matches:
                recorder.record_matches(keypoints[matches[0].frame_a], keypoints[-1], matches[0])
            _forget_patches(keypoints, frame.index - longest_gap)
            clock.progress("front-end", frame.index + 1, len(sequence))
        report.counts = {
            "frames": len(sequence),
            "keypoints": sum(len(frame) for frame in keypoints),
            "matches": sum(len(match) for match in candidates),
            **_count_rejected(candidates),
        }
    return keypoints, candidates


def predict_poses(sequence: Sequence, config: Config) -> PosePrediction | None:
    """Predict the sonar's poses from the odometry before the images are looked at; None without odometry."""
    start = initialise_from_odometry(sequence, config)
    if start is None:
        return None
    noise, lever_m = sequence.noise, float(np.linalg.norm(sequence.vehicle_from_sonar[:3, 3]))
    return PosePrediction(
        start.world_from_vehicle @ sequence.vehicle_from_sonar,
        noise.odometry_rotation_rad,
        float(np.hypot(noise.odometry_translation_m, lever_m * noise.odometry_rotation_rad)),
    )


def _count_rejected(candidates: list[Matches]) -> dict[str, int]:
    """Count what each filter rejected over all pairs of frames."""
    counts: dict[str, int] = {}
    for matches in candidates:
        for name, count in matches.count_rejected().items():
            counts[f"rejected by {name}"] = counts.get(f"rejected by {name}", 0) + count
    return counts


def estimate(
    sequence: Sequence, keypoints: list[Keypoints], candidates: list[Matches], config: Config, clock: StageClock
) -> tuple[Sequence, Solution, tuple[Diagnostic, ...]]:
    """Find poses and points; once more with the mounting and the range bias corrected, where these are estimated.

    Returns:
        The sequence, its lever arm corrected where that was asked for, the solution, and what is to be warned of.
    """
    candidates, duplicates = drop_duplicate_frames(keypoints, candidates, initialise_from_odometry(sequence, config))
    start = initialise(sequence, keypoints, candidates, config, clock)
    solution = optimise(sequence, keypoints, candidates, start, config, clock)
    calibration = estimate_calibration(solution, config, clock)
    if calibration.sigma.any():
        sequence, keypoints, candidates = apply_calibration(calibration, sequence, keypoints, candidates)
        start = replace(start, world_from_vehicle=solution.bundle.world_from_vehicle)
        solution = optimise(sequence, keypoints, candidates, start, config, clock)
    if not start.sensors.measured:
        with clock.stage("relax"):
            solution = correct_partial_mirroring(widen_motion_prior(solution, sequence, config), sequence, config)
            solution = choose_mirror(solution, config.backend.scene)
            solution = state_prior_covariance(solution, config.backend.motion_prior_factor)
    return sequence, solution, (*start.sensors.diagnostics, *duplicates, *calibration.diagnose())


def initialise(
    sequence: Sequence, keypoints: list[Keypoints], candidates: list[Matches], config: Config, clock: StageClock
) -> InitialPoses:
    """Start from odometry, or from a chain of planar motions where there is none."""
    with clock.stage("start") as report:
        rng = np.random.default_rng(config.seed)
        start = initialise_from_odometry(sequence, config)
        if start is not None:
            start = verify_odometry(start, sequence, collect_point_pairs(keypoints, candidates), config, rng)
        if start is None or start.unreliable.any():
            tracks = build_tracks(keypoints, candidates)
            if start is None:
                start = initialise_from_tracks(sequence, tracks, config, rng)
            else:
                start = replace_unreliable_steps(start, sequence, tracks, rng)
            report.counts = {"tracks": tracks.count}
    return start


def optimise(
    sequence: Sequence,
    keypoints: list[Keypoints],
    candidates: list[Matches],
    start: InitialPoses,
    config: Config,
    clock: StageClock,
) -> Solution:
    """Alternate association and adjustment, until either changes little or the rounds are over.

    Loops are looked for once poses are better than the start. From then on the points of each round say where tracks
    should be seen that nothing was matched with, and tracks grow.
    """
    poses, proposed = start.world_from_vehicle, list[Matches]()
    before: Solution | None = None
    for number in range(config.backend.rounds):
        with clock.stage(f"round {number + 1}") as report:
            matches = [*candidates, *proposed]
            tracks = associate(keypoints, matches, sequence.sonar, poses @ sequence.vehicle_from_sonar, config)
            solution = solve_tracks(tracks, sequence, poses, start.sensors, config, adjusted=number > 0)
            poses = solution.bundle.world_from_vehicle
            report.counts = {"tracks": tracks.count, "observations": int(solution.observed.sum())}
        clock.progress("optimise", number + 1, config.backend.rounds)
        settled = before is not None and _share_changed(before, solution) < config.tracks.settled_share
        if settled or number + 1 == config.backend.rounds:
            break
        before, proposed = solution, add_matches(proposed, _match_to_landmarks(solution, sequence, keypoints, config))
        if number == 0 and config.loops.enabled:
            with clock.stage("loops") as report:
                loops = find_loops(sequence, keypoints, solution, config, report)
            poses, candidates = loops.world_from_vehicle, candidates + loops.matches
    return solution


def _share_changed(before: Solution, after: Solution) -> float:
    return share_changed(before.tracks, before.observed, after.tracks, after.observed)


def _match_to_landmarks(
    solution: Solution, sequence: Sequence, keypoints: list[Keypoints], config: Config
) -> list[Matches]:
    """Match keypoints with the points of a solution."""
    bundle = solution.bundle
    world_from_sonar = bundle.world_from_vehicle @ sequence.vehicle_from_sonar
    solved = TriangulatedTracks(
        solution.tracks, keypoints, bundle.xyz_m, bundle.in_graph, world_from_sonar, sequence.sonar, config
    )
    return match_to_landmarks(solved, config.tracks.window)


def summarise(
    sequence: Sequence, solution: Solution, config: Config, clock: StageClock, diagnostics: tuple[Diagnostic, ...] = ()
) -> Reconstruction:
    """Describe the landmarks and say what the poses rest on."""
    with clock.stage("landmarks") as report:
        uncertainty = measure_uncertainty(
            solution.bundle, solution.elevation_information_ratio, min(SPAN, len(sequence) - 1)
        )
        mirror = find_mirror(solution, config.backend.scene)
        stated = inflate_for_mirror(uncertainty, solution, mirror)
        landmarks = describe_landmarks(solution, stated.point_m2, sequence, config)
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
            *warn_of_mirror(uncertainty, solution.bundle, mirror),
            *warn_of_unreliable_poses(solution, uncertainty),
        ),
    )


def _forget_patches(keypoints: list[Keypoints], index: int) -> None:
    """Let go of the patches of a frame that no later frame is matched with."""
    if index >= 0:
        keypoints[index] = keypoints[index].without_patches()
