"""Triangulated tracks: tracks with their points and poses, and predicted observations in other frames."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from asfm.config import Config
from asfm.geometry.feature_noise import feature_sigma, gate_sigma
from asfm.geometry.poses import angle_difference, invert, transform
from asfm.geometry.sonar import SonarModel, project, project_jacobian
from asfm.types import BoolArray, FloatArray, IntArray, Keypoints, Tracks

SIGMA_SCALE = 1.2
"""Scale of the standard deviations of observations, to allow for errors of poses and points."""
APERTURE_MARGIN_RAD = 0.02
"""Elevation beyond the aperture at which a point is still observed: beams have no sharp edge."""


@dataclass(frozen=True)
class TriangulatedTracks:
    """Tracks, points and poses of one round of the estimation."""

    tracks: Tracks
    keypoints: Sequence[Keypoints]
    xyz_m: FloatArray
    """(T, 3) points in the world frame."""
    has_point: BoolArray
    """(T,) which tracks have a point."""
    world_from_sonar: FloatArray
    """(N, 4, 4) poses."""
    sonar: SonarModel
    config: Config

    @cached_property
    def sonar_from_world(self) -> FloatArray:
        """(N, 4, 4) inverse poses."""
        return invert(self.world_from_sonar)

    @cached_property
    def default_sigma(self) -> FloatArray:
        """Standard deviations (2,) of a feature's range_m and bearing_rad."""
        return feature_sigma(self.sonar, self.config.noise)

    @cached_property
    def sigma(self) -> FloatArray:
        """(O, 2) standard deviations of the observations' range_m and bearing_rad, at least the default ones."""
        return gate_sigma(self.tracks, self.sonar, self.config.noise)

    @property
    def keypoint(self) -> IntArray:
        """(O,) index of each observation's keypoint in its frame."""
        assert self.tracks.keypoint is not None, "these tracks were made from keypoints"
        return self.tracks.keypoint

    @cached_property
    def by_frame(self) -> list[IntArray]:
        """Indices (K,) of the observations of each frame."""
        return self.tracks.by_frame(len(self.keypoints))

    @cached_property
    def _xyz_in_sonar(self) -> FloatArray:
        """(O, 3) the point of each observation in its sonar frame."""
        return transform(self.sonar_from_world[self.tracks.frame], self.xyz_m[self.tracks.track])

    @cached_property
    def inlier(self) -> BoolArray:
        """(O,) which observations agree with the projection of their track's point."""
        range_m, bearing_rad, elevation_rad = project(self._xyz_in_sonar)
        difference_rad = angle_difference(bearing_rad, self.tracks.bearing_rad)
        residual = np.stack([range_m - self.tracks.range_m, difference_rad], axis=1)
        near = ((residual / (SIGMA_SCALE * self.sigma)) ** 2).sum(axis=1) <= self.config.matching.arc_gate**2
        inside = np.abs(elevation_rad) <= self.sonar.elevation_aperture_rad / 2 + APERTURE_MARGIN_RAD
        return np.asarray(near & inside & self.has_point[self.tracks.track])

    @cached_property
    def covariance_m2(self) -> FloatArray:
        """(T, 3, 3) covariances of the points under fixed poses, from inliers and one aperture prior per point."""
        jacobian = project_jacobian(self._xyz_in_sonar) @ self.sonar_from_world[self.tracks.frame, :3, :3]
        views = np.bincount(self.tracks.track, self.inlier, minlength=self.tracks.count)
        # One prior per point, spread over its views by scaling its sigma.
        elevation_rad = self.sonar.elevation_aperture_rad / 2 * np.sqrt(np.maximum(views, 1))[self.tracks.track]
        scale = 1 / np.column_stack([SIGMA_SCALE * self.sigma, elevation_rad]) * self.inlier[:, None]
        whitened = jacobian * scale[..., None]
        information = np.einsum("oki,okj->oij", whitened, whitened).reshape(-1, 9)
        total = [np.bincount(self.tracks.track, information[:, cell], minlength=self.tracks.count) for cell in range(9)]
        return np.asarray(np.linalg.inv(np.stack(total, axis=1).reshape(-1, 3, 3) + 1e-9 * np.eye(3)))


@dataclass(frozen=True)
class Prediction:
    """Predicted observations of points in one frame."""

    track: IntArray
    """(P,) track of each point."""
    nearest: IntArray
    """(P,) inlier observation of each track that is nearest in time."""
    range_m: FloatArray
    """(P,)"""
    bearing_rad: FloatArray
    """(P,)"""
    covariance: FloatArray
    """(P, 2, 2) covariances of range_m and bearing_rad, propagated from those of the points."""


def predict_observations(triangulated: TriangulatedTracks, frame: int, window: int) -> Prediction:
    """Predict the observations in a frame of points that it lacks but that nearby frames observe.

    Args:
        triangulated: tracks, points and poses of one round.
        frame: index of the frame.
        window: largest distance in frames of an inlier observation.

    Returns:
        Predictions inside the image and the aperture.
    """
    track, nearest = _unobserved_tracks(triangulated, frame, window)
    xyz_in_sonar = transform(triangulated.sonar_from_world[frame], triangulated.xyz_m[track])
    range_m, bearing_rad, elevation_rad = project(xyz_in_sonar)
    ranges_m, bearings_rad = triangulated.sonar.range_edges_m, triangulated.sonar.bearing_edges_rad
    inside = (range_m >= ranges_m[0]) & (range_m <= ranges_m[-1])
    inside &= (bearing_rad >= bearings_rad[0]) & (bearing_rad <= bearings_rad[-1])
    inside &= np.abs(elevation_rad) <= triangulated.sonar.elevation_aperture_rad / 2 + APERTURE_MARGIN_RAD
    jacobian = (project_jacobian(xyz_in_sonar[inside]) @ triangulated.sonar_from_world[frame, :3, :3])[:, :2]
    covariance = np.einsum("pij,pjk,plk->pil", jacobian, triangulated.covariance_m2[track[inside]], jacobian)
    return Prediction(track[inside], nearest[inside], range_m[inside], bearing_rad[inside], covariance)


def _unobserved_tracks(triangulated: TriangulatedTracks, frame: int, window: int) -> tuple[IntArray, IntArray]:
    """Return the tracks (P,) with an inlier in the window but no observation in the frame, and that inlier (P,)."""
    frames = range(max(frame - window, 0), min(frame + window + 1, len(triangulated.keypoints)))
    nearby = np.concatenate([triangulated.by_frame[other] for other in frames])
    nearby = nearby[triangulated.inlier[nearby]]
    gap = np.abs(triangulated.tracks.frame[nearby] - frame)
    order = np.lexsort((triangulated.tracks.frame[nearby], gap, triangulated.tracks.track[nearby]))
    track, first = np.unique(triangulated.tracks.track[nearby[order]], return_index=True)
    absent = ~np.isin(track, triangulated.tracks.track[triangulated.by_frame[frame]])
    return track[absent], nearby[order][first[absent]]
