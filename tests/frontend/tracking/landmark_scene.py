"""A scene of landmarks that every frame observes, with known poses, keypoints and tracks."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.config import Config
from asfm.frontend.tracking.triangulated_tracks import TriangulatedTracks
from asfm.geometry.feature_noise import feature_sigma
from asfm.geometry.poses import invert, make_pose, transform, wrap_angle
from asfm.geometry.sonar import SonarModel, project
from asfm.types import BoolArray, FloatArray, IntArray, Keypoints, Matches, Tracks
from tests.worlds import make_keypoints, random_points

SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.7, 0.7), (600, 256), 0.35)
CONFIG = Config()
FRAMES, POINTS = 9, 50
MIDDLE = FRAMES // 2


@dataclass(frozen=True)
class LandmarkScene:
    """Points and poses; keypoint k of frame f shows point order[f][k]."""

    xyz_m: FloatArray
    world_from_sonar: FloatArray
    keypoints: list[Keypoints]
    order: list[IntArray]

    def triangulate(self, label: IntArray) -> TriangulatedTracks:
        """Join the observations with equal labels (FRAMES, POINTS), from 0, into tracks with their true points."""
        frame, keypoint = (value.ravel() for value in np.indices((FRAMES, POINTS)))
        point = np.stack(self.order)[frame, keypoint]
        tracked = label[frame, point] >= 0
        frame, keypoint, point = frame[tracked], keypoint[tracked], point[tracked]
        _, track = np.unique(label[frame, point], return_inverse=True)
        order = np.lexsort((frame, track))
        frame, keypoint, point, track = frame[order], keypoint[order], point[order], track[order]
        range_m, bearing_rad = (
            np.array([getattr(self.keypoints[f], name)[k] for f, k in zip(frame, keypoint, strict=True)])
            for name in ("range_m", "bearing_rad")
        )
        of_track = point[np.searchsorted(track, np.arange(track[-1] + 1))]
        return TriangulatedTracks(
            Tracks(track, frame, range_m, bearing_rad, keypoint=keypoint),
            self.keypoints,
            self.xyz_m[of_track],
            np.ones(len(of_track), dtype=bool),
            self.world_from_sonar,
            SONAR,
            CONFIG,
        )

    def points_of(self, match: Matches) -> tuple[IntArray, IntArray]:
        """Return the points (M,) behind the keypoints of frames a and b."""
        return self.order[match.frame_a][match.index[:, 0]], self.order[match.frame_b][match.index[:, 1]]

    def displace(self, which: BoolArray) -> "LandmarkScene":
        """Move the keypoints of some (POINTS,) points in the middle frame by 0.5 m in range."""
        frame = self.keypoints[MIDDLE]
        range_m = frame.range_m + np.where(which[self.order[MIDDLE]], 0.5, 0)
        moved = make_keypoints(range_m, frame.bearing_rad, frame.descriptors, sonar=SONAR)
        return replace(self, keypoints=[*self.keypoints[:MIDDLE], moved, *self.keypoints[MIDDLE + 1 :]])


def make_scene(seed: int = 0, noise: float = 0.5) -> LandmarkScene:
    """Make poses with heave and roll, which determine elevations, and descriptors that differ in a few bits a frame."""
    rng = np.random.default_rng(seed)
    step = np.arange(FRAMES)
    xyz_m = np.stack([0.05 * step, 0.05 * step, 0.1 * np.sin(step)], axis=1)
    poses = make_pose(xyz_m, Rotation.from_euler("ZYX", np.stack([0.01 * step, 0 * step, 0.4 * np.sin(step)], 1)))
    points = random_points(rng, POINTS, (3, 8), 0.4, 0.02)
    descriptors = rng.integers(0, 256, (POINTS, 61), dtype=np.uint8)
    sigma = noise * feature_sigma(SONAR, CONFIG.noise)
    keypoints, order = [], []
    for pose in poses:
        shown = rng.permutation(POINTS)
        range_m, bearing_rad, _ = project(transform(invert(pose), points[shown]))
        flips = np.uint8(1) << rng.integers(0, 8, (POINTS, 61), dtype=np.uint8)
        flips[rng.random((POINTS, 61)) > 0.2] = 0
        noisy = range_m + rng.normal(0, sigma[0], POINTS), bearing_rad + rng.normal(0, sigma[1], POINTS)
        keypoints.append(make_keypoints(*noisy, descriptors[shown] ^ flips, sonar=SONAR))
        order.append(shown)
    return LandmarkScene(points, poses, keypoints, order)


def one_track_per_point() -> IntArray:
    """Return labels (FRAMES, POINTS) that join all observations of each point."""
    return np.tile(np.arange(POINTS), (FRAMES, 1))


def without_frame(frame: int) -> IntArray:
    """Return labels (FRAMES, POINTS) of tracks that lack their observations in one frame."""
    label = one_track_per_point()
    label[frame] = -1
    return label


ALL_AROUND = SonarModel.evenly_spaced("all around", (0.5, 10.0), (-np.pi, np.pi), (600, 1149), 0.35)
"""Sonar of the same pixels that sees behind itself."""


def turn_astern(triangulated: TriangulatedTracks) -> TriangulatedTracks:
    """Mount the sonar the other way round: what was ahead lies behind, at bearings near pi and -pi."""
    half_turn = make_pose(np.zeros(3), Rotation.from_rotvec([0.0, 0.0, np.pi]))

    def turn(bearing_rad: FloatArray) -> FloatArray:
        return wrap_angle(bearing_rad + np.pi)

    return replace(
        triangulated,
        tracks=replace(triangulated.tracks, bearing_rad=turn(triangulated.tracks.bearing_rad)),
        keypoints=[replace(frame, bearing_rad=turn(frame.bearing_rad)) for frame in triangulated.keypoints],
        world_from_sonar=triangulated.world_from_sonar @ half_turn,
    )
