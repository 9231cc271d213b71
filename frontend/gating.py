"""Gating: a match is possible only where its point lies near the elevation arc of the other frame's pixel."""

from dataclasses import dataclass

import numpy as np

from asfm.poses import invert
from asfm.sonar import SonarModel, project
from asfm.types import BoolArray, FloatArray


@dataclass(frozen=True)
class PredictedPoses:
    """Where each frame's sonar is thought to be before the images are looked at, and how surely."""

    world_from_sonar: FloatArray
    """(N, 4, 4)"""
    step_rotation_rad: float
    """Standard deviation of one step's rotation, each axis."""
    step_translation_m: float
    """Standard deviation of one step's translation, each axis."""

    def relate(self, frame_a: int, frame_b: int) -> FloatArray:
        """Give the (4, 4) relative pose b_from_a of two frames' sonars."""
        return np.asarray(invert(self.world_from_sonar[frame_b]) @ self.world_from_sonar[frame_a])

    def spread(self, frame_a: int, frame_b: int, range_m: FloatArray, sigma: FloatArray) -> FloatArray:
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
    seen = np.stack([range_m, bearing_rad], axis=-1)
    white = (seen - pixel_b[:, None, :]) / np.asarray(sigma).reshape(-1, 1, 2)
    start, step = white[:, :-1], np.diff(white, axis=1)
    length2 = np.maximum(np.einsum("mgi,mgi->mg", step, step), 1e-30)
    along = np.clip(-np.einsum("mgi,mgi->mg", start, step) / length2, 0, 1)
    nearest = start + along[..., None] * step
    return np.asarray(np.sqrt(np.einsum("mgi,mgi->mg", nearest, nearest).min(axis=1)))


def near_arcs(
    sonar: SonarModel, b_from_a: FloatArray, pixel_a: FloatArray, pixel_b: FloatArray, reach: FloatArray, count: int = 5
) -> BoolArray:
    """Tell quickly which pixels of frame b may lie on the elevation arc of each pixel of frame a.

    Each arc is taken for the box of range and bearing that holds it, so some that are not near are let pass.

    Args:
        sonar: gives the aperture.
        b_from_a: (4, 4) the relative pose of the two sonars.
        pixel_a: (Ka, 2) range_m and bearing_rad.
        pixel_b: (Kb, 2) range_m and bearing_rad.
        reach: (Ka, 2) how far beyond its arc a pixel may lie, in range_m and bearing_rad.
        count: points of each arc.

    Returns:
        (Ka, Kb).
    """
    arc = sonar.elevation_arc(pixel_a[:, 0], pixel_a[:, 1], count)
    range_m, bearing_rad, _ = project(arc @ b_from_a[:3, :3].T + b_from_a[:3, 3])
    bearing_rad = np.unwrap(bearing_rad, axis=1)
    sides = [
        (pixel_b[:, axis], seen.min(axis=1) - reach[:, axis], seen.max(axis=1) + reach[:, axis])
        for axis, seen in enumerate((range_m, bearing_rad))
    ]
    nearer, farther, starboard, port = (
        compare(value, bound[:, None])
        for value, low, high in sides
        for compare, bound in ((np.greater_equal, low), (np.less_equal, high))
    )
    return np.asarray(nearer & farther & starboard & port)
