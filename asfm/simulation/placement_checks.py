"""Placement checks of the sonar: distance to the scene, inside an object, nothing in view."""

import numpy as np

from asfm.errors import AsfmError
from asfm.simulation.acoustics.rays import RayCaster, RayFan
from asfm.simulation.scenes.scene import Scene
from asfm.types import FloatArray, ImageArray

PROBE_DIRECTIONS = 128
MAX_BACK_FACE_SHARE = 0.3
"""Largest share of all directions that meet the back of a face; a sonar in a solid, or under the ground, exceeds it."""
MAX_DISTANCE_M = 1e5
RAY_STRIDE = 29
"""Every 29th ray of a ping is cast to find out whether anything is in view."""


def check_distance(scene: Scene, poses: FloatArray) -> None:
    """Check that the sonar is within 100 km of the scene, where float32 rays are accurate.

    Args:
        scene: the mesh.
        poses: (N, 4, 4) world_from_sonar.

    Raises:
        AsfmError: a pose is farther away; the message names the first.
    """
    if not len(scene.vertices_m):
        return
    middle_m = 0.5 * (scene.vertices_m.min(axis=0) + scene.vertices_m.max(axis=0))
    away_m = np.abs(poses[:, :3, 3] - middle_m).max(axis=-1)
    for index in np.flatnonzero(~(away_m < MAX_DISTANCE_M))[:1]:
        raise AsfmError(
            f"scene {scene.name}: at frame {index} the sonar is {away_m[index]:.3g} m away, expected at most "
            f"{MAX_DISTANCE_M:g} m; is the path in metres and in the scene's coordinates?"
        )


def check_outside(scene: Scene, caster: RayCaster, poses: FloatArray) -> None:
    """Check that the sonar is not inside an object or under the ground.

    Args:
        scene: the mesh; an open one, whose inside is undefined, is not checked.
        caster: casts rays into the scene.
        poses: (N, 4, 4) world_from_sonar.

    Raises:
        AsfmError: a pose is inside; the message names the first.
    """
    if not scene.winds_outward:
        return
    directions = _sphere_directions(PROBE_DIRECTIONS)
    max_range_m = float(np.linalg.norm(np.ptp(scene.vertices_m, axis=0))) + 1.0
    for index, pose in enumerate(poses):
        if (caster.cast(pose, directions, max_range_m).cos_incidence > 0).mean() > MAX_BACK_FACE_SHARE:
            x, y, z = pose[:3, 3]
            raise AsfmError(
                f"scene {scene.name}: at frame {index} the sonar at ({x:.2f}, {y:.2f}, {z:.2f}) m is inside an object; "
                "choose another motion, seed or sonar range"
            )


def _sphere_directions(count: int) -> ImageArray:
    """Return (3, count) unit vectors evenly over the sphere (a Fibonacci lattice)."""
    height = 1 - 2 * (np.arange(count) + 0.5) / count
    azimuth = np.pi * (1 + 5**0.5) * np.arange(count)
    horizontal = np.sqrt(1 - height**2)
    return np.stack([horizontal * np.cos(azimuth), horizontal * np.sin(azimuth), height]).astype(np.float32)


def count_empty_views(caster: RayCaster, fan: RayFan, poses: FloatArray, range_m: tuple[float, float]) -> int:
    """Count the poses from which no ray hits anything within range.

    Args:
        caster: casts rays into the scene.
        fan: the rays of one ping; a subset of them is cast.
        poses: (N, 4, 4) world_from_sonar.
        range_m: nearest and farthest range.
    """
    directions = np.ascontiguousarray(fan.direction[:, ::RAY_STRIDE])
    count = 0
    for pose in poses:
        hits = caster.cast(pose, directions, range_m[1])
        count += not np.any((hits.face >= 0) & (hits.range_m >= range_m[0]))
    return count
