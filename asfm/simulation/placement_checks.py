"""Is the sonar where a sonar can be, and does it see anything?"""

import numpy as np

from asfm.errors import AsfmError
from asfm.simulation.acoustics.rays import RayCaster, RayFan
from asfm.simulation.scenes.scene import Scene
from asfm.types import FloatArray, ImageArray

DIRECTIONS = 128
BACK_SIDES = 0.3
"""Share of all directions that may meet the back of a face; a sonar in a solid, or under the ground, meets more."""
FARTHEST_M = 1e5
COARSE = 29
"""Every so manyth ray tells whether there is anything in view."""


def check_near(scene: Scene, poses: FloatArray) -> None:
    """Make sure that every pose of the sonar, (N, 4, 4), is within 100 km of the scene, where rays are exact.

    Raises:
        AsfmError: one is not; the message names the first.
    """
    if not len(scene.vertices_m):
        return
    middle_m = 0.5 * (scene.vertices_m.min(axis=0) + scene.vertices_m.max(axis=0))
    away_m = np.abs(poses[:, :3, 3] - middle_m).max(axis=-1)
    for index in np.flatnonzero(~(away_m < FARTHEST_M))[:1]:
        raise AsfmError(
            f"scene {scene.name}: at frame {index} the sonar is {away_m[index]:.3g} m away, expected at most "
            f"{FARTHEST_M:g} m; is the path in metres and in the scene's coordinates?"
        )


def check_outside(scene: Scene, caster: RayCaster, poses: FloatArray) -> None:
    """Make sure that no pose of the sonar, (N, 4, 4), is inside an object or under the ground.

    Raises:
        AsfmError: one is; the message names the first.
    """
    if not scene.winds_outward:
        return
    everywhere = _spread_directions(DIRECTIONS)
    farthest_m = float(np.linalg.norm(np.ptp(scene.vertices_m, axis=0))) + 1.0
    for index, pose in enumerate(poses):
        if (caster.cast(pose, everywhere, farthest_m).toward > 0).mean() > BACK_SIDES:
            x, y, z = pose[:3, 3]
            raise AsfmError(
                f"scene {scene.name}: at frame {index} the sonar at ({x:.2f}, {y:.2f}, {z:.2f}) m is inside an object; "
                "choose another motion, seed or sonar range"
            )


def _spread_directions(count: int) -> ImageArray:
    """(3, count) directions evenly over the sphere (a Fibonacci lattice)."""
    height = 1 - 2 * (np.arange(count) + 0.5) / count
    turn = np.pi * (1 + 5**0.5) * np.arange(count)
    flat = np.sqrt(1 - height**2)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), height]).astype(np.float32)


def count_blind(caster: RayCaster, fan: RayFan, poses: FloatArray, range_m: tuple[float, float]) -> int:
    """Count the poses, of (N, 4, 4), from which no ray strikes anything within range."""
    some = np.ascontiguousarray(fan.direction[:, ::COARSE])
    blind = 0
    for pose in poses:
        hits = caster.cast(pose, some, range_m[1])
        blind += not np.any((hits.face >= 0) & (hits.range_m >= range_m[0]))
    return blind
