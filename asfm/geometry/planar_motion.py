"""Motion in a plane between two views of the same points: a closed form, and the motion that most agree with.

Points of the plane are complex numbers x + iy: a turn is then one product. With the turn q, |q| = 1, and the shift t
the motion is a = q b + t; least squares give q = sum(conj(db) da) / |...| about the centroids (2-D Kabsch).
"""

import numpy as np
from numpy.typing import NDArray

from asfm.types import BoolArray, FloatArray, IntArray

ComplexArray = NDArray[np.complex128]
REFITS = 3
"""How often the motion is fitted again to those that agree."""


def estimate_planar_motion_msac(
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
    centre = xy_a.mean(axis=0), xy_b.mean(axis=0)
    a, b = _as_complex(xy_a - centre[0]), _as_complex(xy_b - centre[1])
    limit2 = np.asarray(tolerance_m, dtype=float) ** 2
    turns, shifts = _fit_pairs(a, b, picks)
    apart2 = _squared_distances(a, b, turns, shifts)
    far = np.asarray(~(apart2 < limit2))
    best = int(np.argmin(np.where(far, 1.0, apart2 / limit2).sum(axis=1)))
    turn, shift, agrees = turns[best], shifts[best], ~far[best]
    for _ in range(REFITS):
        if agrees.sum() < 2:
            turn, shift, agrees = turns[best], shifts[best], ~far[best]
            break
        refit = _fit(a[None, agrees], b[None, agrees])
        turn, shift = refit[0][0], refit[1][0]
        before, agrees = agrees, np.asarray(_squared_distances(a, b, *refit)[0] < limit2)
        if np.array_equal(before, agrees):
            break
    middle_a, middle_b = complex(*centre[0]), complex(*centre[1])
    return _lift(turn, shift + middle_a - turn * middle_b), agrees


def _fit_pairs(a: ComplexArray, b: ComplexArray, picks: IntArray) -> tuple[ComplexArray, ComplexArray]:
    """Fit turns (T,) and shifts (T,) to pairs of points: along the line between the two, from middle to middle."""
    first, second = picks.T
    moment = np.conj(b[first] - b[second]) * (a[first] - a[second])
    turn = _unit(moment)
    return turn, 0.5 * (a[first] + a[second] - turn * (b[first] + b[second]))


def _unit(moment: ComplexArray) -> ComplexArray:
    length = np.abs(moment)
    return np.asarray(np.where(length > 0, moment, 1.0) / np.where(length > 0, length, 1.0))


def _fit(a: ComplexArray, b: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Fit turns (T,) and shifts (T,) of a = turn * b + shift to (T, M) points; no turn where the points coincide."""
    centre_a, centre_b = a.mean(axis=1), b.mean(axis=1)
    moment = (np.conj(b - centre_b[:, None]) * (a - centre_a[:, None])).sum(axis=1)
    turn = _unit(moment)
    return turn, centre_a - turn * centre_b


def _squared_distances(a: ComplexArray, b: ComplexArray, turn: ComplexArray, shift: ComplexArray) -> FloatArray:
    """How far (T, M) each moved point b lies from its point a, squared, by one matrix product.

    |q b + t - a|^2 = |a|^2 + |b|^2 + |t|^2 + 2 Re(conj(t) q b) - 2 Re(q b conj(a)) - 2 Re(conj(t) a), for |q| = 1.
    """
    both, back, ones = np.conj(shift) * turn, b * np.conj(a), np.ones(len(shift))
    motions = [ones, np.abs(shift) ** 2, both.real, -both.imag, -turn.real, turn.imag, -shift.real, -shift.imag]
    fixed = np.abs(a) ** 2 + np.abs(b) ** 2
    points = [fixed, np.ones(len(a)), 2 * b.real, 2 * b.imag, 2 * back.real, 2 * back.imag, 2 * a.real, 2 * a.imag]
    return np.asarray(np.array(motions).T @ np.array(points))


def _lift(turn: complex, shift: complex) -> FloatArray:
    """Place a motion of the plane into (4, 4) space."""
    pose = np.eye(4)
    pose[:2, :2] = [[turn.real, -turn.imag], [turn.imag, turn.real]]
    pose[:2, 3] = shift.real, shift.imag
    return pose


def _as_complex(xy: FloatArray) -> ComplexArray:
    return np.asarray(xy[:, 0] + 1j * xy[:, 1])
