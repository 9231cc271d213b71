"""Reflection of poses, points and small motions at the x-y plane of a sonar frame."""

import numpy as np

from asfm.geometry.poses import adjoint, invert, transform
from asfm.types import FloatArray

REFLECTION = np.diag([1.0, 1.0, -1.0, 1.0])
"""Reflection of the sonar frame at its x-y plane."""


def reflect(
    world_from_vehicle: FloatArray, xyz_m: FloatArray, vehicle_from_sonar: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Reflect poses and points at the x-y plane of the first sonar frame; the first pose does not change.

    Args:
        world_from_vehicle: (N, 4, 4) poses.
        xyz_m: (T, 3) points in the world frame.
        vehicle_from_sonar: (4, 4) lever arm.

    Returns:
        (N, 4, 4) poses and (T, 3) points.
    """
    reflection = reflection_at(world_from_vehicle[0] @ vehicle_from_sonar)
    return reflect_after(world_from_vehicle, 0, vehicle_from_sonar), transform(reflection, xyz_m)


def reflect_after(world_from_vehicle: FloatArray, frame: int, vehicle_from_sonar: FloatArray) -> FloatArray:
    """Reflect the poses after a frame at the x-y plane of its sonar frame.

    Args:
        world_from_vehicle: (N, 4, 4) poses.
        frame: last one that does not change.
        vehicle_from_sonar: (4, 4) lever arm.

    Returns:
        (N, 4, 4) poses.
    """
    world_from_sonar = world_from_vehicle @ vehicle_from_sonar
    reflection = reflection_at(world_from_sonar[frame])
    mirrored = reflection @ world_from_sonar[frame + 1 :] @ REFLECTION @ invert(vehicle_from_sonar)
    return np.concatenate([world_from_vehicle[: frame + 1], mirrored])


def reflection_at(world_from_sonar: FloatArray) -> FloatArray:
    """Return the (4, 4) reflection of the world at the x-y plane of a sonar frame."""
    return np.asarray(world_from_sonar @ REFLECTION @ invert(world_from_sonar))


def reflected_motion_jacobian(vehicle_from_sonar: FloatArray) -> FloatArray:
    """Return the (6, 6) matrix from a small motion in the vehicle frame to that of its mirror image.

    In the sonar frame rotations about x and y and translations along z change their sign.
    """
    signs = np.diag([-1.0, -1.0, 1.0, 1.0, 1.0, -1.0])
    return np.asarray(adjoint(vehicle_from_sonar) @ signs @ adjoint(invert(vehicle_from_sonar)))
