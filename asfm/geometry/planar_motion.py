"""Planar rigid motion between two views of the same points: MSAC with a closed-form least-squares fit.

Points of the plane are complex numbers x + iy, so a rotation is a product. The motion is a = q b + t with the rotation
q, |q| = 1, and the translation t. Least squares give q = sum(conj(db) da) / |...| about the centroids (2-D Kabsch).
"""

import numpy as np
from numpy.typing import NDArray

from asfm.types import BoolArray, FloatArray, IntArray

ComplexArray = NDArray[np.complex128]
MAX_REFITS = 3
"""Maximum number of least-squares fits to the inliers."""


def estimate_planar_motion_msac(
    xy_a: FloatArray, xy_b: FloatArray, tolerance_m: FloatArray, samples: IntArray
) -> tuple[FloatArray, BoolArray]:
    """Estimate the planar motion a_from_b by MSAC (Torr and Zisserman 2000) over given minimal samples.

    The points have elevation zero: (r cos(theta), r sin(theta)). The motion of the sample with the smallest sum of
    truncated squared distances is refined by least squares on its inliers.

    Args:
        xy_a: (M, 2) points in frame a, in metres, M >= 2.
        xy_b: (M, 2) the same points in frame b.
        tolerance_m: (M,) distance below which a point is an inlier, above zero.
        samples: (T, 2) indices of the pairs of points to fit, T >= 1.

    Returns:
        (4, 4) a_from_b with a motion in the plane only, and (M,) true for the inliers.
    """
    centroid = xy_a.mean(axis=0), xy_b.mean(axis=0)
    a, b = _as_complex(xy_a - centroid[0]), _as_complex(xy_b - centroid[1])
    tolerance2 = np.asarray(tolerance_m, dtype=float) ** 2
    rotations, translations = _fit_pairs(a, b, samples)
    distance2 = _squared_distances(a, b, rotations, translations)
    outlier = np.asarray(~(distance2 < tolerance2))
    best = int(np.argmin(np.where(outlier, 1.0, distance2 / tolerance2).sum(axis=1)))
    rotation, translation, inlier = rotations[best], translations[best], ~outlier[best]
    for _ in range(MAX_REFITS):
        if inlier.sum() < 2:
            rotation, translation, inlier = rotations[best], translations[best], ~outlier[best]
            break
        refit = _fit(a[None, inlier], b[None, inlier])
        rotation, translation = refit[0][0], refit[1][0]
        before, inlier = inlier, np.asarray(_squared_distances(a, b, *refit)[0] < tolerance2)
        if np.array_equal(before, inlier):
            break
    centroid_a, centroid_b = complex(*centroid[0]), complex(*centroid[1])
    return _planar_pose(rotation, translation + centroid_a - rotation * centroid_b), inlier


def _fit_pairs(a: ComplexArray, b: ComplexArray, samples: IntArray) -> tuple[ComplexArray, ComplexArray]:
    """Fit (T,) rotations and translations to pairs of points: align their directions, then their midpoints."""
    first, second = samples.T
    moment = np.conj(b[first] - b[second]) * (a[first] - a[second])
    rotation = _normalise(moment)
    return rotation, 0.5 * (a[first] + a[second] - rotation * (b[first] + b[second]))


def _normalise(moment: ComplexArray) -> ComplexArray:
    """Scale (T,) complex numbers to modulus 1; zero becomes 1, no rotation."""
    length = np.abs(moment)
    return np.asarray(np.where(length > 0, moment, 1.0) / np.where(length > 0, length, 1.0))


def _fit(a: ComplexArray, b: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Fit (T,) rotations and translations of a = q b + t to (T, M) points; no rotation if the points coincide."""
    centroid_a, centroid_b = a.mean(axis=1), b.mean(axis=1)
    moment = (np.conj(b - centroid_b[:, None]) * (a - centroid_a[:, None])).sum(axis=1)
    rotation = _normalise(moment)
    return rotation, centroid_a - rotation * centroid_b


def _squared_distances(a: ComplexArray, b: ComplexArray, q: ComplexArray, t: ComplexArray) -> FloatArray:
    """Compute the squared distances of M points a from the points b under T motions, by one matrix product: (T, M).

    |q b + t - a|^2 = |a|^2 + |b|^2 + |t|^2 + 2 Re(conj(t) q b) - 2 Re(q b conj(a)) - 2 Re(conj(t) a), for |q| = 1.
    """
    tq, ba, ones = np.conj(t) * q, b * np.conj(a), np.ones(len(t))
    motions = [ones, np.abs(t) ** 2, tq.real, -tq.imag, -q.real, q.imag, -t.real, -t.imag]
    constant = np.abs(a) ** 2 + np.abs(b) ** 2
    points = [constant, np.ones(len(a)), 2 * b.real, 2 * b.imag, 2 * ba.real, 2 * ba.imag, 2 * a.real, 2 * a.imag]
    return np.asarray(np.array(motions).T @ np.array(points))


def _planar_pose(rotation: complex, translation: complex) -> FloatArray:
    """Convert a planar motion to a (4, 4) rigid transform."""
    pose = np.eye(4)
    pose[:2, :2] = [[rotation.real, -rotation.imag], [rotation.imag, rotation.real]]
    pose[:2, 3] = translation.real, translation.imag
    return pose


def _as_complex(xy: FloatArray) -> ComplexArray:
    return np.asarray(xy[:, 0] + 1j * xy[:, 1])
