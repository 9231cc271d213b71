"""Elevation arcs: the acoustic counterpart of epipolar lines, and distances of matches from them.

A pixel fixes range and bearing and leaves the elevation open. Its arc, seen from another frame, holds every place where
a match can lie.
"""

import numpy as np

from asfm.geometry.poses import wrap_angle
from asfm.geometry.sonar import SonarModel, project
from asfm.types import BoolArray, FloatArray


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
    seen[..., 1] = middle_rad + wrap_angle(bearing_rad - middle_rad)
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
