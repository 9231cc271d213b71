"""Faults of the images: reversed axes, jumps, and matches without odometry where this is suspected of a fault."""

from dataclasses import dataclass, replace

import numpy as np

from asfm.backend.initialisation.initial_poses import InitialPoses, initialise_from_odometry
from asfm.config import Config
from asfm.diagnostics import Diagnostic
from asfm.geometry.feature_noise import feature_sigma
from asfm.geometry.poses import depth_roll_pitch, wrap_angle
from asfm.navigation.fault_diagnostics import diagnose_images, diagnose_mounting
from asfm.navigation.fault_hypotheses import ImageAxis
from asfm.navigation.frame_navigation import FrameNavigation
from asfm.navigation.image_jumps import diagnose_image_jumps, find_image_jumps
from asfm.navigation.image_order import diagnose_image_order, find_misplaced_frames
from asfm.navigation.odometry_check import OdometryTest, compare_odometry_hypotheses
from asfm.navigation.odometry_hypotheses import AS_RECORDED, PointPairs, collect_point_pairs, planar_inliers
from asfm.pipeline.feature_matching import ExtractMatches, extract_matches
from asfm.recorder import NullRecorder, Recorder
from asfm.sequence import Sequence
from asfm.stages import StageClock
from asfm.types import Frame, Keypoints, Matches


@dataclass(frozen=True)
class MatchedSequence:
    """A sequence with its keypoints and matches."""

    sequence: Sequence
    keypoints: list[Keypoints]
    matches: list[Matches]
    diagnostics: tuple[Diagnostic, ...] = ()


def rematch_suspected(
    matched: MatchedSequence,
    navigation: FrameNavigation,
    config: Config,
    recorder: Recorder,
    clock: StageClock,
    extract: ExtractMatches | None = None,
) -> MatchedSequence:
    """Match again without odometry where the odometry lies beyond the noise; turn what is turned.

    A wrong odometry gates right matches away, so it is judged on matches that it did not gate. Images whose axis is
    reversed and a turned mounting are corrected; the mounting only where attitude does not say that odometry is turned.

    Args:
        matched: the sequence, with matches gated by its odometry.
        navigation: odometry, depth and attitude at the frames.
        config: every setting.
        recorder: observer of frames and matches; sees turned images again.
        clock: times the stages.
        extract: the front-end in place of :func:`extract_matches`.

    Returns:
        The same where the odometry is not suspected.

    Raises:
        AsfmError: a frame cannot be read.
    """
    test = _test_odometry(matched, navigation, config)
    if test is None or not test.suspicious:
        return matched
    sequence, extract = matched.sequence, extract or extract_matches
    matched = MatchedSequence(sequence, *extract(sequence, config, NullRecorder(), clock, None, None))
    test = _test_odometry(matched, navigation, config)
    if test is None:
        return matched
    if test.mounting is not None and _attitude_fits(test, navigation):
        mounted = replace(sequence, vehicle_from_sonar=test.mounting)
        return replace(matched, sequence=mounted, diagnostics=(diagnose_mounting(test),))
    if test.image_axis is None:
        return matched
    turned = reverse_images(sequence, test.image_axis)
    found = (diagnose_images(test),)
    return MatchedSequence(turned, *extract(turned, config, recorder, clock, None, None), found)


def reverse_images(sequence: Sequence, axis: ImageAxis) -> Sequence:
    """Return a sequence whose images have their rows (range) or columns (bearing) in reversed order."""

    def read_frame(index: int) -> Frame:
        frame, along = sequence.read_frame(index), 0 if axis == "range" else 1
        return replace(
            frame,
            image=np.ascontiguousarray(np.flip(frame.image, along)),
            invalid=np.ascontiguousarray(np.flip(frame.invalid, along)),
        )

    return replace(sequence, read_frame=read_frame)


def report_image_jumps(
    start: InitialPoses, sequence: Sequence, pairs: list[PointPairs], keypoints: list[Keypoints], config: Config
) -> InitialPoses:
    """Add a diagnostic where the images jump and odometry does not.

    Args:
        start: poses from the odometry as recorded.
        sequence: gives the sonar and its lever arm.
        pairs: matched points of near frames.
        keypoints: those of every frame.
        config: section ``noise``.
    """
    jumps = find_image_jumps(
        start.world_from_vehicle @ sequence.vehicle_from_sonar,
        start.sensors.step_sigma,
        pairs,
        np.array([len(frame) for frame in keypoints]),
        sequence.sonar,
        feature_sigma(sequence.sonar, config.noise),
    )
    found = diagnose_image_jumps(jumps & ~start.unreliable)
    return replace(start, sensors=replace(start.sensors, diagnostics=(*start.sensors.diagnostics, *found)))


def report_image_order(
    start: InitialPoses, sequence: Sequence, keypoints: list[Keypoints], candidates: list[Matches], config: Config
) -> InitialPoses:
    """Add a diagnostic where images without odometry are in another order than they were made.

    Args:
        start: poses from tracks.
        sequence: gives the sonar.
        keypoints: those of every frame.
        candidates: matches of pairs of frames.
        config: section ``noise``.
    """
    misplaced = find_misplaced_frames(keypoints, candidates, feature_sigma(sequence.sonar, config.noise))
    found = diagnose_image_order(misplaced)
    return replace(start, sensors=replace(start.sensors, diagnostics=(*start.sensors.diagnostics, *found)))


def _attitude_fits(test: OdometryTest, navigation: FrameNavigation) -> bool:
    """Tell whether roll and pitch agree with the odometry as recorded at least as well as with the turned one."""
    measured = navigation.depth_attitude.z_roll_pitch
    if not len(measured):
        return True
    recorded_rad, turned_rad = (
        float(
            np.median(np.abs(wrap_angle(depth_roll_pitch(test.hypotheses[name].world_from_vehicle) - measured)[:, 1:]))
        )
        for name in (AS_RECORDED, str(test.likely_fault))
    )
    return recorded_rad <= turned_rad


def _test_odometry(matched: MatchedSequence, navigation: FrameNavigation, config: Config) -> OdometryTest | None:
    """Compare hypotheses of faults; None without odometry or with too few matches."""
    start = initialise_from_odometry(navigation, matched.sequence)
    if start is None:
        return None
    pairs = [
        pair
        for pair in collect_point_pairs(matched.keypoints, matched.matches)
        if not start.unreliable[pair.frame_a : pair.frame_b].any()
    ]
    inliers = planar_inliers(pairs, np.random.default_rng(config.seed))
    return compare_odometry_hypotheses(
        start.world_from_vehicle, start.sensors, inliers, matched.sequence, config, pairs
    )
