"""Tracks with the points and poses that a round has made of them, and where those points should be seen next."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from asfm.config import Config
from asfm.geometry.feature_noise import feature_sigma, gate_sigma
from asfm.geometry.poses import invert, transform
from asfm.geometry.sonar import SonarModel, project, project_jacobian
from asfm.types import BoolArray, FloatArray, IntArray, Keypoints, Tracks

WIDENED = 1.2
"""Sigmas are widened by this, because neither poses nor points are exact."""
EDGE_RAD = 0.02
"""How far outside the aperture a point is still seen: beams do not end sharply."""


@dataclass(frozen=True)
class TriangulatedTracks:
    """What a round knows: tracks, their points and the poses that saw them."""

    tracks: Tracks
    keypoints: Sequence[Keypoints]
    xyz_m: FloatArray
    """(T, 3) points in the world."""
    has_point: BoolArray
    """(T,) which tracks have a point."""
    world_from_sonar: FloatArray
    """(N, 4, 4)"""
    sonar: SonarModel
    config: Config

    @cached_property
    def sonar_from_world(self) -> FloatArray:
        """(N, 4, 4)"""
        return invert(self.world_from_sonar)

    @cached_property
    def default_sigma(self) -> FloatArray:
        """Standard deviations (2,) of a feature's range_m and bearing_rad."""
        return feature_sigma(self.sonar, self.config.noise)

    @cached_property
    def sigma(self) -> FloatArray:
        """(O, 2) standard deviations of the observations' range_m and bearing_rad, at least the typical ones."""
        return gate_sigma(self.tracks, self.sonar, self.config.noise)

    @property
    def keypoint(self) -> IntArray:
        """(O,) index of each observation's keypoint in its frame."""
        assert self.tracks.keypoint is not None, "these tracks were made from keypoints"
        return self.tracks.keypoint

    @cached_property
    def by_frame(self) -> list[IntArray]:
        """The observations of each frame."""
        return self.tracks.by_frame(len(self.keypoints))

    @cached_property
    def _seen(self) -> FloatArray:
        """(O, 3) each observation's point in the frame of its sonar."""
        return transform(self.sonar_from_world[self.tracks.frame], self.xyz_m[self.tracks.track])

    @cached_property
    def inlier(self) -> BoolArray:
        """(O,) which observations lie where their track's point should be seen."""
        range_m, bearing_rad, elevation_rad = project(self._seen)
        off = np.stack([range_m - self.tracks.range_m, bearing_rad - self.tracks.bearing_rad], axis=1)
        near = ((off / (WIDENED * self.sigma)) ** 2).sum(axis=1) <= self.config.matching.arc_gate**2
        inside = np.abs(elevation_rad) <= self.sonar.elevation_aperture_rad / 2 + EDGE_RAD
        return np.asarray(near & inside & self.has_point[self.tracks.track])

    @cached_property
    def covariance_m2(self) -> FloatArray:
        """(T, 3, 3) of the points under these poses: what agreeing observations say, and once that the beam sees it."""
        jacobian = project_jacobian(self._seen) @ self.sonar_from_world[self.tracks.frame, :3, :3]
        views = np.bincount(self.tracks.track, self.inlier, minlength=self.tracks.count)
        elevation_rad = self.sonar.elevation_aperture_rad / 2 * np.sqrt(np.maximum(views, 1))[self.tracks.track]
        scale = 1 / np.column_stack([WIDENED * self.sigma, elevation_rad]) * self.inlier[:, None]
        white = jacobian * scale[..., None]
        each = np.einsum("oki,okj->oij", white, white).reshape(-1, 9)
        total = [np.bincount(self.tracks.track, each[:, cell], minlength=self.tracks.count) for cell in range(9)]
        return np.asarray(np.linalg.inv(np.stack(total, axis=1).reshape(-1, 3, 3) + 1e-9 * np.eye(3)))


@dataclass(frozen=True)
class Prediction:
    """Where one frame should see some of the points."""

    track: IntArray
    """(P,)"""
    nearest: IntArray
    """(P,) agreeing observation of each track that is nearest in time."""
    range_m: FloatArray
    """(P,)"""
    bearing_rad: FloatArray
    """(P,)"""
    covariance: FloatArray
    """(P, 2, 2) of range_m and bearing_rad, from the points' own."""


def predict_observations(triangulated: TriangulatedTracks, frame: int, window: int) -> Prediction:
    """Predict which points a frame should see, of the tracks observed at most a window of frames away but not in it.

    Args:
        triangulated: a round's result.
        frame: index of the frame.
        window: how many frames away an agreeing observation may be.
    """
    track, nearest = _list_absent(triangulated, frame, window)
    seen = transform(triangulated.sonar_from_world[frame], triangulated.xyz_m[track])
    range_m, bearing_rad, elevation_rad = project(seen)
    rows, beams = triangulated.sonar.range_edges_m, triangulated.sonar.bearing_edges_rad
    inside = (range_m >= rows[0]) & (range_m <= rows[-1]) & (bearing_rad >= beams[0]) & (bearing_rad <= beams[-1])
    inside &= np.abs(elevation_rad) <= triangulated.sonar.elevation_aperture_rad / 2 + EDGE_RAD
    slopes = (project_jacobian(seen[inside]) @ triangulated.sonar_from_world[frame, :3, :3])[:, :2]
    spread = np.einsum("pij,pjk,plk->pil", slopes, triangulated.covariance_m2[track[inside]], slopes)
    return Prediction(track[inside], nearest[inside], range_m[inside], bearing_rad[inside], spread)


def _list_absent(triangulated: TriangulatedTracks, frame: int, window: int) -> tuple[IntArray, IntArray]:
    """List the tracks that agree in a neighbouring frame but have nothing in this one, with the nearest observation."""
    frames = range(max(frame - window, 0), min(frame + window + 1, len(triangulated.keypoints)))
    around = np.concatenate([triangulated.by_frame[other] for other in frames])
    around = around[triangulated.inlier[around]]
    away = np.abs(triangulated.tracks.frame[around] - frame)
    order = np.lexsort((triangulated.tracks.frame[around], away, triangulated.tracks.track[around]))
    track, first = np.unique(triangulated.tracks.track[around[order]], return_index=True)
    absent = ~np.isin(track, triangulated.tracks.track[triangulated.by_frame[frame]])
    return track[absent], around[order][first[absent]]
