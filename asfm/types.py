"""Data types passed between the packages: frozen dataclasses and nothing else.

Conventions: metres, radians, seconds. Sonar frame x forward, y to port, z up. An image is float32
in 0..1 of shape (ranges, beams); row 0 is nearest, column 0 is the most starboard beam. Pixel centres are at +0.5.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from asfm.consistency import Consistency
from asfm.diagnostics import Diagnostic

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
ImageArray = NDArray[np.float32]
Descriptors = NDArray[np.uint8] | NDArray[np.float32]


@dataclass(frozen=True)
class Frame:
    """One ping of the sonar."""

    index: int
    timestamp_s: float
    image: ImageArray
    """(ranges, beams), echo strength in 0..1, finite everywhere."""
    invalid: BoolArray
    """(ranges, beams), true where the pixel holds no data (overlay, dead beam)."""
    decibel_span: float | None = None
    """Decibels spanned by 0..1 where the image is logarithmic; None where it is proportional to the amplitude."""

    @property
    def amplitude(self) -> ImageArray:
        """(ranges, beams) image proportional to the echo amplitude, in 0..1."""
        if self.decibel_span is None:
            return self.image
        return np.asarray(np.float32(10) ** ((self.image - 1) * np.float32(self.decibel_span / 20)), dtype=np.float32)


@dataclass(frozen=True)
class Trajectory:
    """Poses with their time stamps."""

    timestamps_s: FloatArray
    """(N,), strictly rising."""
    world_from_vehicle: FloatArray
    """(N, 4, 4) rigid transforms."""


@dataclass(frozen=True)
class Navigation:
    """Depth and attitude readings; world z up, rotation = Rz(yaw) Ry(pitch) Rx(roll)."""

    timestamps_s: FloatArray
    """(N,), strictly rising."""
    z_m: FloatArray
    roll_rad: FloatArray
    pitch_rad: FloatArray


@dataclass(frozen=True)
class SensorNoise:
    """Standard deviations of a sequence's sensors."""

    odometry_translation_m: float = 0.02
    """Each axis, one step between frames."""
    odometry_rotation_rad: float = 0.005
    """Each axis, one step between frames."""
    navigation_z_m: float = 0.02
    navigation_roll_rad: float = 0.005
    navigation_pitch_rad: float = 0.005


@dataclass(frozen=True)
class HandTracks:
    """Points of the scene tracked through the images by hand."""

    timestamps_s: FloatArray
    """(O,), as the other arrays."""
    landmark: IntArray
    range_m: FloatArray
    bearing_rad: FloatArray


@dataclass(frozen=True)
class Keypoints:
    """The features of one frame."""

    row_column: FloatArray
    """(K, 2) fractional row and column of the polar image, pixel centres at +0.5."""
    range_m: FloatArray
    """(K,)"""
    bearing_rad: FloatArray
    """(K,)"""
    response: FloatArray
    """(K,) detector response."""
    descriptors: Descriptors
    """(K, D) bytes of binary descriptors, compared by Hamming distance, or float32, compared by Euclidean distance."""
    patches: ImageArray
    """(K, 2r+1, 2r+1) patches of the warped image around each keypoint; (0, ...) once they are dropped."""

    def __len__(self) -> int:
        return len(self.range_m)

    @property
    def range_bearing(self) -> FloatArray:
        """(K, 2) range_m and bearing_rad."""
        return np.stack([self.range_m, self.bearing_rad], axis=1)

    def without_patches(self) -> "Keypoints":
        """Return the same keypoints without their patches, which take most of the memory."""
        return replace(self, patches=self.patches[:0])


@dataclass(frozen=True)
class Matches:
    """Matched keypoints of two frames."""

    frame_a: int
    frame_b: int
    index: IntArray
    """(M, 2) keypoint of frame_a, keypoint of frame_b: the matches that passed every filter."""
    cost: FloatArray
    """(M,) smaller is more reliable; tracks are built from the cheapest matches first."""
    rejected: NDArray[np.int32] = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int32))
    """(R, 2) keypoint of frame_a, keypoint of frame_b: the matches that a filter rejected."""
    rejected_by: NDArray[np.int8] = field(default_factory=lambda: np.zeros(0, dtype=np.int8))
    """(R,) index into filters of the one that rejected it."""
    filters: tuple[str, ...] = ()
    """Names of the filters that were applied, in their order."""
    sigma: FloatArray | None = None
    """(M, 2) standard deviations of the keypoints' range_m and bearing_rad, from the alignment of their patches."""

    def __len__(self) -> int:
        return len(self.index)

    def reject(self, which: BoolArray, name: str) -> "Matches":
        """Move the selected (M,) matches to the rejected ones, under the name of a filter."""
        filters = self.filters if name in self.filters else (*self.filters, name)
        number = np.full(int(which.sum()), filters.index(name), dtype=np.int8)
        return replace(
            self,
            index=self.index[~which],
            cost=self.cost[~which],
            sigma=None if self.sigma is None else self.sigma[~which],
            rejected=np.concatenate([self.rejected, self.index[which].astype(np.int32)]),
            rejected_by=np.concatenate([self.rejected_by, number]),
            filters=filters,
        )

    def count_rejected(self) -> dict[str, int]:
        """Return the number of matches that each filter rejected, by its name."""
        counts = np.bincount(self.rejected_by, minlength=len(self.filters)).tolist()
        return dict(zip(self.filters, counts, strict=True))


@dataclass(frozen=True)
class ExternalMatches:
    """Keypoints and matches of a whole sequence, computed by another detector and matcher."""

    keypoints: tuple[Keypoints, ...]
    """One set a frame, without patches."""
    matches: tuple[Matches, ...]
    """frame_a precedes frame_b; at most one entry for each pair of frames."""

    @property
    def longest_gap(self) -> int:
        """Largest frame gap between two matched frames; 0 without matches."""
        return max((match.frame_b - match.frame_a for match in self.matches), default=0)

    def with_previous(self, frame: int) -> list[Matches]:
        """Return the matches of a frame with the frames before it, smallest gap first."""
        return sorted((match for match in self.matches if match.frame_b == frame), key=lambda match: -match.frame_a)


@dataclass(frozen=True)
class Tracks:
    """Observations of landmarks in frames, sorted by (track, frame): the only interface of front-end and back-end."""

    track: IntArray
    """(O,) index of the track, 0..count-1, without gaps."""
    frame: IntArray
    """(O,) index of the frame; no two observations of a track share one."""
    range_m: FloatArray
    """(O,)"""
    bearing_rad: FloatArray
    """(O,)"""
    sigma: FloatArray | None = None
    """(O, 2) standard deviations of range_m and bearing_rad; None where only the sonar's default ones are known."""
    keypoint: IntArray | None = None
    """(O,) index of each observation's keypoint in its frame; None where the tracks were not made from keypoints."""

    def __len__(self) -> int:
        return len(self.track)

    def select(self, chosen: BoolArray) -> "Tracks":
        """Return the chosen (O,) observations, with the remaining tracks renumbered."""
        _, track = np.unique(self.track[chosen], return_inverse=True)
        return Tracks(
            track=track.astype(np.int64),
            frame=self.frame[chosen],
            range_m=self.range_m[chosen],
            bearing_rad=self.bearing_rad[chosen],
            sigma=None if self.sigma is None else self.sigma[chosen],
            keypoint=None if self.keypoint is None else self.keypoint[chosen],
        )

    def by_frame(self, frame_count: int, chosen: BoolArray | None = None) -> list[IntArray]:
        """Return the indices of each frame's observations, or of those of them that are (O,) chosen."""
        order = np.argsort(self.frame, kind="stable")
        if chosen is not None:
            order = order[chosen[order]]
        return np.split(order, np.searchsorted(self.frame[order], np.arange(1, frame_count)))

    def frame_span(self, chosen: BoolArray | None = None) -> tuple[IntArray, IntArray]:
        """Return the first and the last frame (T,) of each track's chosen (O,) observations; 0 and 0 without any."""
        index = np.arange(len(self)) if chosen is None else np.flatnonzero(chosen)
        track, begin, count = np.unique(self.track[index], return_index=True, return_counts=True)
        first, last = np.zeros(self.count, dtype=np.int64), np.zeros(self.count, dtype=np.int64)
        first[track], last[track] = self.frame[index[begin]], self.frame[index[begin + count - 1]]
        return first, last

    @property
    def count(self) -> int:
        """Number of tracks."""
        return int(self.track[-1]) + 1 if len(self.track) else 0


@dataclass(frozen=True)
class Landmarks:
    """Triangulated points with their uncertainty."""

    track: IntArray
    """(L,) the track each landmark was made from."""
    xyz_m: FloatArray
    """(L, 3) in the world frame."""
    covariance_m2: FloatArray
    """(L, 3, 3) marginal covariance in the world frame."""
    sigma_m: FloatArray
    """(L,) square root of the covariance's largest eigenvalue."""
    views: IntArray
    """(L,) number of frames that observe the landmark."""
    well_constrained: BoolArray
    """(L,) false where the motion does not determine the elevation: the arc is shown instead of the point."""
    arc_m: FloatArray
    """(L, A, 3) elevation arc of the last frame that observed the landmark, in the world frame."""

    def __len__(self) -> int:
        return len(self.track)


@dataclass(frozen=True)
class Reconstruction:
    """Result of a run."""

    trajectory: Trajectory
    """One pose a frame of the sequence."""
    tracks: Tracks
    observed: BoolArray
    """(O,) observations in the final graph; the others are outliers of their track's point."""
    landmarks: Landmarks
    pose_covariance: FloatArray
    """(N, 6, 6) marginal covariance of each pose: rotation in rad and translation in m, in the vehicle's frame."""
    diagnostics: tuple[Diagnostic, ...]
    """Empty when all went well."""
    consistency: Consistency = field(default_factory=Consistency)
    """Residuals over stated noise, and scores of the calibration."""


@dataclass(frozen=True)
class FrameTruth:
    """Ground truth of a simulated frame."""

    elevation_rad: FloatArray
    """(ranges, beams), elevation of each pixel's strongest surface, energy-weighted; NaN where nothing echoes."""
    clean: ImageArray
    """(ranges, beams), the image without noise, in 0..1."""
