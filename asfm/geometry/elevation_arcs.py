"""Gating: a match is possible only where its point lies near the elevation arc of the other frame's pixel."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from asfm.geometry.poses import invert
from asfm.geometry.sonar import SonarModel, project
from asfm.types import BoolArray, FloatArray


@dataclass(frozen=True)
class PosePrediction:
    """Where each frame's sonar is thought to be before the images are looked at, and how surely."""

    world_from_sonar: FloatArray
    """(N, 4, 4)"""
    step_rotation_rad: float
    """Standard deviation of one step's rotation, each axis."""
    step_translation_m: float
    """Standard deviation of one step's translation, each axis."""

    def relative_pose(self, frame_a: int, frame_b: int) -> FloatArray:
        """Give the (4, 4) relative pose b_from_a of two frames' sonars."""
        return np.asarray(self._sonar_from_world[frame_b] @ self.world_from_sonar[frame_a])

    @cached_property
    def _sonar_from_world(self) -> FloatArray:
        return invert(self.world_from_sonar)

    def predicted_sigma(self, frame_a: int, frame_b: int, range_m: FloatArray, sigma: FloatArray) -> FloatArray:
        """Add the prediction's uncertainty to the noise of a point.

        The errors of the steps are independent, so they grow with the square root of the gap. A translation shows in
        the range, and in the bearing over the range; a rotation in the bearing.

        Args:
            range_m: (K,) ranges of points.
            sigma: (2,) standard deviations of range_m and bearing_rad under exact poses.

        Returns:
            (K, 2) standard deviations of range_m and bearing_rad.
        """
        root = np.sqrt(abs(frame_b - frame_a))
        shift_m, turn_rad = root * self.step_translation_m, root * self.step_rotation_rad
        across_rad = shift_m / np.maximum(range_m, 1e-9)
        bearing_rad = np.minimum(np.sqrt(sigma[1] ** 2 + turn_rad**2 + across_rad**2), np.pi)
        return np.stack([np.full(len(range_m), np.hypot(sigma[0], shift_m)), bearing_rad], axis=1)


def arc_residuals(
    sonar: SonarModel,
    b_from_a: FloatArray,
    pixel_a: FloatArray,
    pixel_b: FloatArray,
    sigma: FloatArray,
    count: int = 15,
) -> FloatArray:
    """Measure how far each match is from the elevation arc, in sigmas.

    The arc of the pixel in frame a (range and bearing held, elevation over the aperture) is seen from frame b; the
    residual is the smallest whitened distance to the pixel in frame b over a grid of elevations, refined on the
    segments between the grid's points.

    Args:
        sonar: gives the aperture.
        b_from_a: (M, 4, 4) the relative pose of the two sonars, one a match.
        pixel_a, pixel_b: (M, 2) range_m and bearing_rad.
        sigma: (2,) or (M, 2) standard deviations of the difference in range_m and bearing_rad.
        count: points of the grid of elevations.

    Returns:
        (M,) residual, 1 meaning one sigma.
    """
    arc = sonar.elevation_arc(pixel_a[:, 0], pixel_a[:, 1], count)
    arc_in_b = np.einsum("mij,mgj->mgi", b_from_a[:, :3, :3], arc) + b_from_a[:, None, :3, 3]
    range_m, bearing_rad, _ = project(arc_in_b)
    return arc_distances(np.stack([range_m, bearing_rad], axis=-1), pixel_b, sigma)


def arc_distances(seen: FloatArray, pixel_b: FloatArray, sigma: FloatArray) -> FloatArray:
    """Measure how far pixels are from arcs, in sigmas; an arc is straight between its points.

    Args:
        seen: (M, G, 2) range_m and bearing_rad of the points of each arc.
        pixel_b: (M, 2) range_m and bearing_rad.
        sigma: (2,) or (M, 2) standard deviations of the difference in range_m and bearing_rad.

    Returns:
        (M,) residual, 1 meaning one sigma.
    """
    white = (seen - pixel_b[:, None, :]) / np.asarray(sigma).reshape(-1, 1, 2)
    start, step = white[:, :-1], np.diff(white, axis=1)
    length2 = np.maximum(np.einsum("mgi,mgi->mg", step, step), 1e-30)
    along = np.clip(-np.einsum("mgi,mgi->mg", start, step) / length2, 0, 1)
    nearest = start + along[..., None] * step
    return np.asarray(np.sqrt(np.einsum("mgi,mgi->mg", nearest, nearest).min(axis=1)))


def project_arcs(sonar: SonarModel, b_from_a: FloatArray, pixel_a: FloatArray, count: int = 7) -> FloatArray:
    """Carry the elevation arcs of one frame's pixels into another frame.

    Args:
        sonar: gives the aperture.
        b_from_a: (4, 4) the relative pose of the two sonars.
        pixel_a: (K, 2) range_m and bearing_rad.
        count: points of each arc.

    Returns:
        (K, count, 2) range_m and bearing_rad in frame b; the bearing of one arc does not jump at pi.
    """
    elevation_rad = sonar.elevations(count)
    horizontal = pixel_a[:, 0, None] * np.cos(elevation_rad)
    arc = np.empty((len(pixel_a), count, 3))
    arc[..., 0] = horizontal * np.cos(pixel_a[:, 1, None])
    arc[..., 1] = horizontal * np.sin(pixel_a[:, 1, None])
    arc[..., 2] = pixel_a[:, 0, None] * np.sin(elevation_rad)
    x, y, z = np.moveaxis(arc @ b_from_a[:3, :3].T + b_from_a[:3, 3], -1, 0)
    seen = np.empty((len(pixel_a), count, 2))
    seen[..., 0] = np.sqrt(x * x + y * y + z * z)
    bearing_rad = np.arctan2(y, x)
    middle_rad = bearing_rad[:, count // 2, None]
    seen[..., 1] = middle_rad + np.remainder(bearing_rad - middle_rad + np.pi, 2 * np.pi) - np.pi
    return seen


def arc_box_candidates(seen: FloatArray, pixel_b: FloatArray, reach: FloatArray) -> BoolArray:
    """Tell quickly which pixels of frame b may lie on each arc.

    An arc is taken for the box of range and bearing that holds it, so some that are not near are let pass.

    Args:
        seen: (Ka, G, 2) range_m and bearing_rad of the points of each arc, in frame b.
        pixel_b: (Kb, 2) range_m and bearing_rad.
        reach: (Ka, 2) how far beyond its arc a pixel may lie, in range_m and bearing_rad.

    Returns:
        (Ka, Kb).
    """
    least, greatest = seen.min(axis=1) - reach, seen.max(axis=1) + reach
    near = pixel_b[:, 0] >= least[:, :1]
    near &= pixel_b[:, 0] <= greatest[:, :1]
    near &= pixel_b[:, 1] >= least[:, 1:]
    near &= pixel_b[:, 1] <= greatest[:, 1:]
    return np.asarray(near)
