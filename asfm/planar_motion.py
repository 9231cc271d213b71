"""Motion in a plane between two views of the same points: a closed form, and the motion that most agree with.

Points of the plane are complex numbers x + iy: a turn is then one product. With the turn q, |q| = 1, and the shift t
the motion is a = q b + t; least squares give q = sum(conj(db) da) / |...| about the centroids (2-D Kabsch).
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from asfm.poses import make_pose
from asfm.types import BoolArray, FloatArray, IntArray

ComplexArray = NDArray[np.complex128]
REFITS = 3
"""How often the motion is fitted again to those that agree."""


def agree_on_planar_motion(
    xy_a: FloatArray, xy_b: FloatArray, tolerance_m: FloatArray, picks: IntArray
) -> tuple[FloatArray, BoolArray]:
    """Find the planar motion a_from_b that most points agree with, trying that of each picked pair of points.

    The points are those of elevation zero, (r cos(theta), r sin(theta)). The best motion has the least sum of
    truncated squared distances (MSAC).

    Args:
        xy_a, xy_b: (M, 2) the same points seen from two frames, M >= 2.
        tolerance_m: (M,) how far an agreeing point may lie, above zero.
        picks: (T, 2) pairs of points to try, T >= 1.

    Returns:
        (4, 4) a_from_b with no motion out of the plane, (M,) which points agree.
    """
    a, b = _as_complex(xy_a), _as_complex(xy_b)
    tolerance_m = np.asarray(tolerance_m, dtype=float)
    turn, shift = _fit(a[picks], b[picks])
    distance = _distances(a, b, turn, shift) / tolerance_m
    best = int(np.argmin((np.where(distance < 1, distance, 1.0) ** 2).sum(axis=1)))
    agrees = distance[best] < 1
    refit = turn[best], shift[best]
    for _ in range(REFITS):
        if agrees.sum() < 2:
            return _lift(turn[best], shift[best]), agrees
        one_turn, one_shift = _fit(a[None, agrees], b[None, agrees])
        agrees = _distances(a, b, one_turn, one_shift)[0] / tolerance_m < 1
        refit = one_turn[0], one_shift[0]
    return _lift(*refit), agrees


def _distances(a: ComplexArray, b: ComplexArray, turn: ComplexArray, shift: ComplexArray) -> FloatArray:
    """How far (T, M) each moved point b lies from its point a."""
    apart = turn[:, None] * b
    apart += shift[:, None] - a
    return np.asarray(np.abs(apart))


def _fit(a: ComplexArray, b: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Fit turns (T,) and shifts (T,) of a = turn * b + shift to (T, M) points; no turn where the points coincide."""
    centre_a, centre_b = a.mean(axis=1), b.mean(axis=1)
    moment = (np.conj(b - centre_b[:, None]) * (a - centre_a[:, None])).sum(axis=1)
    length = np.abs(moment)
    turn = np.where(length > 0, moment / np.where(length > 0, length, 1.0), 1.0)
    return turn, centre_a - turn * centre_b


def _as_complex(xy: FloatArray) -> ComplexArray:
    return np.asarray(xy[:, 0] + 1j * xy[:, 1])


def _lift(turn: complex, shift: complex) -> FloatArray:
    """Place a motion of the plane into (4, 4) space."""
    return make_pose(np.array([shift.real, shift.imag, 0.0]), Rotation.from_euler("z", float(np.angle(turn))))
