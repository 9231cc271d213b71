"""Gating: a match is possible only where its point lies near the elevation arc of the other frame's pixel."""

import numpy as np

from asfm.sonar import SonarModel, project
from asfm.types import FloatArray


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
