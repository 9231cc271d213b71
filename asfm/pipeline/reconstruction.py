"""Reconstruction pipeline: acoustic structure from motion, from images to trajectory and landmarks."""

from dataclasses import dataclass, field, replace

import numpy as np

from asfm.backend.ambiguity.mirror_ambiguity import choose_mirror
from asfm.backend.ambiguity.motion_prior import state_prior_covariance, widen_motion_prior
from asfm.backend.ambiguity.partial_mirroring import correct_partial_mirroring
from asfm.backend.estimation.solution import Solution, solve_tracks
from asfm.backend.initialisation.initial_poses import (
    InitialPoses,
    initialise_from_odometry,
    initialise_from_tracks,
    replace_unreliable_steps,
    search_from_tracks,
    verify_odometry,
)
from asfm.config import Config, NoiseConfig
from asfm.diagnostics import Diagnostic
from asfm.frontend.tracking.association import associate
from asfm.frontend.tracking.guided_matching import add_matches, match_to_landmarks
from asfm.frontend.tracking.track_builder import build_tracks, share_changed
from asfm.frontend.tracking.triangulated_tracks import TriangulatedTracks
from asfm.geometry.local_origin import shift_reconstruction
from asfm.navigation.duplicate_frames import drop_duplicate_frames
from asfm.navigation.frame_navigation import FrameNavigation, read_navigation
from asfm.navigation.local_world import move_to_local_origin, with_world_of
from asfm.navigation.odometry_hypotheses import collect_point_pairs
from asfm.navigation.pose_prediction import predict_poses
from asfm.pipeline.feature_matching import ExtractMatches, extract_matches
from asfm.pipeline.image_faults import MatchedSequence, rematch_suspected, report_image_jumps, report_image_order
from asfm.pipeline.loop_closure import find_loops
from asfm.pipeline.noise_estimation import estimate_noise
from asfm.pipeline.self_calibration import apply_calibration, estimate_calibration
from asfm.pipeline.summary import summarise
from asfm.recorder import NullRecorder, Recorder
from asfm.sequence import Sequence
from asfm.stages import Progress, StageClock, StageReport, no_progress
from asfm.types import ExternalMatches, Keypoints, Matches, Reconstruction


@dataclass(frozen=True)
class Run:
    """A reconstruction, the matches it was made from, and the time it took."""

    reconstruction: Reconstruction
    stages: tuple[StageReport, ...]
    keypoints: tuple[Keypoints, ...]
    """Of every frame, without patches."""
    matches: tuple[Matches, ...]
    """Of the frame pairs in the matching window, after the outlier filters; their (M, 2) indices are of keypoints."""
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    """Of the features, as the gates used it: estimated, or as the configuration states it."""


def reconstruct(
    sequence: Sequence,
    config: Config | None = None,
    recorder: Recorder | None = None,
    progress: Progress = no_progress,
    external: ExternalMatches | None = None,
    extract: ExtractMatches | None = None,
) -> Run:
    """Reconstruct the trajectory and the landmarks of a sequence.

    Images become keypoints and candidate matches once. Association and optimisation then alternate, as better poses
    select better matches. All of it works about a local origin, so that the result does not depend on where the origin
    of the world is.

    Args:
        sequence: frames and their navigation, if any.
        config: every setting; the defaults where it is None.
        recorder: observer of the stages; none by default.
        progress: called with the progress of each stage.
        external: keypoints and matches computed elsewhere in place of asfm's own; no others are added.
        extract: the front-end in place of :func:`extract_matches`, such as one that reads what was computed before.

    Raises:
        AsfmError: a frame cannot be read.
    """
    config, recorder = config or Config(), recorder or NullRecorder()
    clock = StageClock(progress)
    local, origin_m = move_to_local_origin(sequence, config.backend)
    navigation = read_navigation(local, config.backend)
    config = estimate_noise(local, config, clock, external)
    prediction = predict_poses(navigation, local)
    found = (extract or extract_matches)(local, config, recorder, clock, prediction, external)
    matched = MatchedSequence(local, *found)
    if external is None:
        matched = rematch_suspected(matched, navigation, config, recorder, clock, extract)
    keypoints, matches = matched.keypoints, matched.matches
    calibrated, solution, diagnostics = estimate(
        matched.sequence, navigation, keypoints, matches, config, clock, may_add_matches=external is None
    )
    reconstruction = summarise(calibrated, solution, config, clock, (*matched.diagnostics, *diagnostics))
    reconstruction = shift_reconstruction(reconstruction, origin_m)
    with clock.stage("record"):
        recorder.record_reconstruction(with_world_of(calibrated, sequence), reconstruction)
    without_patches = tuple(frame.without_patches() for frame in keypoints)
    return Run(reconstruction, tuple(clock.reports), without_patches, tuple(matches), config.noise)


def estimate(
    sequence: Sequence,
    navigation: FrameNavigation,
    keypoints: list[Keypoints],
    candidates: list[Matches],
    config: Config,
    clock: StageClock,
    may_add_matches: bool = True,
) -> tuple[Sequence, Solution, tuple[Diagnostic, ...]]:
    """Estimate poses and points, and once more with corrected mounting and ranges where their estimation is requested.

    Args:
        sequence: gives sonar, lever arm and stated noise.
        navigation: odometry, depth and attitude at the frames.
        keypoints: those of every frame.
        candidates: matches of pairs of frames.
        config: every setting.
        clock: times the stages.
        may_add_matches: whether guided matching and loop closure may add matches.

    Returns:
        The sequence with its lever arm corrected where that was requested, the solution, and the diagnostics.
    """
    candidates, duplicates = drop_duplicate_frames(keypoints, candidates, navigation.odometry)
    start = initialise(sequence, navigation, keypoints, candidates, config, clock)
    solution = optimise(sequence, keypoints, candidates, start, config, clock, may_add_matches)
    calibration = estimate_calibration(solution, config, clock)
    if calibration.sigma.any():
        sequence, keypoints = apply_calibration(calibration, sequence, keypoints)
        start = replace(start, world_from_vehicle=solution.bundle.world_from_vehicle)
        solution = optimise(sequence, keypoints, candidates, start, config, clock, may_add_matches)
    if not start.sensors.measured:
        with clock.stage("ambiguity"):
            solution = correct_partial_mirroring(widen_motion_prior(solution, sequence, config), sequence, config)
            solution = choose_mirror(solution, config.backend.scene)
            solution = state_prior_covariance(solution, config.backend.motion_prior_factor)
    return sequence, solution, (*start.sensors.diagnostics, *duplicates, *calibration.diagnose())


def initialise(
    sequence: Sequence,
    navigation: FrameNavigation,
    keypoints: list[Keypoints],
    candidates: list[Matches],
    config: Config,
    clock: StageClock,
) -> InitialPoses:
    """Initialise the poses from odometry, or from tracks where there is none."""
    with clock.stage("initialisation") as report:
        rng = np.random.default_rng(config.seed)
        start = initialise_from_odometry(navigation, sequence)
        if start is not None:
            pairs = collect_point_pairs(keypoints, candidates)
            start = report_image_jumps(start, sequence, pairs, keypoints, config)
            start = verify_odometry(start, sequence, pairs, config, rng)
        if start is None or start.unreliable.any():
            tracks = build_tracks(keypoints, candidates)
            if start is None:
                start = initialise_from_tracks(navigation, sequence, tracks, config, rng)
                start = search_from_tracks(start, sequence, tracks, config, rng)
                start = report_image_order(start, sequence, keypoints, candidates, config)
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
    may_add_matches: bool = True,
) -> Solution:
    """Alternate association and bundle adjustment until the observations hardly change or the rounds are used up.

    After the first round loops are closed. From then on the landmarks of each round guide the matching of frames in
    which they should be seen, so tracks grow.
    """
    poses, guided = start.world_from_vehicle, list[Matches]()
    before: Solution | None = None
    for number in range(config.backend.rounds):
        with clock.stage(f"round {number + 1}") as report:
            matches = [*candidates, *guided]
            tracks = associate(keypoints, matches, sequence.sonar, poses @ sequence.vehicle_from_sonar, config)
            solution = solve_tracks(tracks, sequence, poses, start.sensors, config, adjusted=number > 0)
            poses = solution.bundle.world_from_vehicle
            report.counts = {"tracks": tracks.count, "observations": int(solution.observed.sum())}
        clock.progress("optimise", number + 1, config.backend.rounds)
        settled = before is not None and _share_changed(before, solution) < config.tracks.settled_share
        if settled or number + 1 == config.backend.rounds:
            break
        before = solution
        if may_add_matches:
            guided = add_matches(guided, _match_to_landmarks(solution, sequence, keypoints, config))
        if may_add_matches and number == 0 and config.loops.enabled:
            with clock.stage("loops") as report:
                loops = find_loops(sequence, keypoints, solution, config, report)
            poses, candidates = loops.world_from_vehicle, candidates + loops.matches
    return solution


def _share_changed(before: Solution, after: Solution) -> float:
    return share_changed(before.tracks, before.observed, after.tracks, after.observed)


def _match_to_landmarks(
    solution: Solution, sequence: Sequence, keypoints: list[Keypoints], config: Config
) -> list[Matches]:
    bundle = solution.bundle
    world_from_sonar = bundle.world_from_vehicle @ sequence.vehicle_from_sonar
    triangulated = TriangulatedTracks(
        solution.tracks, keypoints, bundle.xyz_m, bundle.in_graph, world_from_sonar, sequence.sonar, config
    )
    return match_to_landmarks(triangulated, config.tracks.window)
