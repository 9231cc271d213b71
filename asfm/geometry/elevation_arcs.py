"""Elevation arcs: the acoustic counterpart of epipolar lines, and distances of matches from them.

A pixel fixes range and bearing but not elevation. Its match in another frame must lie on the projection of the arc of
possible elevations.
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
    """Compute the distance of each match from its elevation arc, in sigmas.

    The arc of the pixel in frame a (fixed range and bearing, all elevations in the aperture) is projected into frame b
    as a polyline over a grid of elevations. The residual is the smallest whitened distance from it to the pixel in b.

    Args:
        sonar: gives the aperture.
        b_from_a: (M, 4, 4) relative pose of the two sonars for each match.
        pixel_a: (M, 2) range_m and bearing_rad in frame a.
        pixel_b: (M, 2) range_m and bearing_rad in frame b.
        sigma: (2,) or (M, 2) standard deviations of the difference in range_m and bearing_rad.
        count: number of elevations in the grid.

    Returns:
        (M,) residuals in sigmas.
    """
    arc = sonar.elevation_arc(pixel_a[:, 0], pixel_a[:, 1], count)
    arc_in_b = np.einsum("mij,mgj->mgi", b_from_a[:, :3, :3], arc) + b_from_a[:, None, :3, 3]
    range_m, bearing_rad, _ = project(arc_in_b)
    return arc_distances(np.stack([range_m, bearing_rad], axis=-1), pixel_b, sigma)


def arc_distances(arcs: FloatArray, pixel_b: FloatArray, sigma: FloatArray) -> FloatArray:
    """Compute the distance of each pixel from a projected arc, in sigmas; an arc is a polyline.

    Args:
        arcs: (M, G, 2) range_m and bearing_rad of the points of each arc in frame b.
        pixel_b: (M, 2) range_m and bearing_rad.
        sigma: (2,) or (M, 2) standard deviations of the difference in range_m and bearing_rad.

    Returns:
        (M,) residuals in sigmas.
    """
    difference = arcs - pixel_b[:, None, :]
    if (np.abs(difference[..., 1]) > np.pi).any():
        difference[..., 1] = np.unwrap(wrap_angle(difference[..., 1]), axis=1)
    whitened = difference / np.asarray(sigma).reshape(-1, 1, 2)
    start, step = whitened[:, :-1], np.diff(whitened, axis=1)
    squared_length = np.maximum(np.einsum("mgi,mgi->mg", step, step), 1e-30)
    fraction = np.clip(-np.einsum("mgi,mgi->mg", start, step) / squared_length, 0, 1)
    nearest = start + fraction[..., None] * step
    return np.asarray(np.sqrt(np.einsum("mgi,mgi->mg", nearest, nearest).min(axis=1)))


def project_arcs(sonar: SonarModel, b_from_a: FloatArray, pixel_a: FloatArray, count: int = 7) -> FloatArray:
    """Project the elevation arcs of a frame's pixels into another frame.

    Args:
        sonar: gives the aperture.
        b_from_a: (4, 4) relative pose of the two sonars.
        pixel_a: (K, 2) range_m and bearing_rad.
        count: number of points per arc.

    Returns:
        (K, count, 2) range_m and bearing_rad in frame b; the bearings of one arc are unwrapped, without jumps at pi.
    """
    elevation_rad = sonar.elevations(count)
    horizontal = pixel_a[:, 0, None] * np.cos(elevation_rad)
    arc = np.empty((len(pixel_a), count, 3))
    arc[..., 0] = horizontal * np.cos(pixel_a[:, 1, None])
    arc[..., 1] = horizontal * np.sin(pixel_a[:, 1, None])
    arc[..., 2] = pixel_a[:, 0, None] * np.sin(elevation_rad)
    x, y, z = np.moveaxis(arc @ b_from_a[:3, :3].T + b_from_a[:3, 3], -1, 0)
    projected = np.empty((len(pixel_a), count, 2))
    projected[..., 0] = np.sqrt(x * x + y * y + z * z)
    bearing_rad = np.arctan2(y, x)
    middle_rad = bearing_rad[:, count // 2, None]
    projected[..., 1] = middle_rad + wrap_angle(bearing_rad - middle_rad)
    return projected


def arc_box_candidates(arcs: FloatArray, pixel_b: FloatArray, margin: FloatArray) -> BoolArray:
    """Return which pixels of frame b lie in the bounding box of each arc.

    The box in range and bearing is a fast test: it keeps every pixel near the arc and some that are not.

    Args:
        arcs: (Ka, G, 2) range_m and bearing_rad of the points of each arc in frame b.
        pixel_b: (Kb, 2) range_m and bearing_rad.
        margin: (Ka, 2) largest distance from the arc in range_m and bearing_rad.

    Returns:
        (Ka, Kb) true for candidates.
    """
    low, high = arcs.min(axis=1) - margin, arcs.max(axis=1) + margin
    inside = pixel_b[:, 0] >= low[:, :1]
    inside &= pixel_b[:, 0] <= high[:, :1]
    at_bearing = np.zeros_like(inside)
    # An arc behind the sonar may reach beyond pi, where its pixels have bearings near -pi.
    beyond = low[:, 1].min(initial=0.0) < -np.pi or high[:, 1].max(initial=0.0) > np.pi
    for turn_rad in (0.0, -2 * np.pi, 2 * np.pi) if beyond else (0.0,):
        bearing_rad = pixel_b[:, 1] + turn_rad
        at_bearing |= (bearing_rad >= low[:, 1:]) & (bearing_rad <= high[:, 1:])
    return np.asarray(inside & at_bearing)
