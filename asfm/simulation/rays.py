"""Rays over azimuth and elevation, and where they strike a mesh (Embree)."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asfm.errors import AsfmError
from asfm.simulation.scene import Scene
from asfm.sonar import SonarModel
from asfm.types import FloatArray, ImageArray, IntArray

GOLDEN = 0.6180339887498949
BOUNCE_GAP_M = 1e-3
"""How far a mirrored ray starts off its surface, so that it does not strike it again."""


@dataclass(frozen=True)
class RayFan:
    """The N rays of one ping in the sonar frame, beam after beam; they do not change with the pose."""

    direction: ImageArray
    """(3, N) unit vectors."""
    column: IntArray
    """(N,) beam that hears the ray."""
    elevation_rad: ImageArray
    """(N,)"""
    solid_angle_sr: ImageArray
    """(N,) that the ray stands for."""
    elevation_step_rad: float
    """Between neighbours of one beam."""


@dataclass(frozen=True)
class Hits:
    """What each of N rays struck first."""

    range_m: ImageArray
    """(N,), the farthest range where nothing was struck."""
    toward: ImageArray
    """(N,) cosine between the ray and the face's outward normal, negative in front; zero where nothing was struck."""
    upward: ImageArray
    """(N,) cosine between the sonar's z axis and the face's outward normal; zero where nothing was struck."""
    normal: ImageArray
    """(3, N) outward normals in the world's directions, of any length; zero where nothing was struck."""
    unit: ImageArray
    """(N,) factors that make the normals unit vectors."""
    place_m: ImageArray
    """(3, N) in the world's directions, relative to the scene's middle."""
    face: NDArray[np.int32]
    """(N,) index of the face, -1 where nothing was struck."""


def make_ray_fan(sonar: SonarModel, rays_per_beam: int) -> RayFan:
    """Spread rays evenly over every beam's cell of azimuth and elevation.

    The rays of a beam form a rank-1 lattice (golden ratio across the beam), shifted from beam to beam, so that
    neither thin objects nor the rows of the image meet a regular grid, which would show as moire.
    """
    beams = len(sonar.bearing_rad)
    edges = sonar.bearing_edges_rad
    step_rad = sonar.elevation_aperture_rad / rays_per_beam
    ray = np.arange(rays_per_beam)
    beam = np.arange(beams)[:, None]
    across = (GOLDEN * (ray + 1) + 0.7548776662466927 * beam) % 1.0
    along = (ray + (0.5 + 0.5698402909980532 * beam) % 1.0) * step_rad
    bearing = edges[:-1, None] + across * np.diff(edges)[:, None]
    elevation = along - sonar.elevation_aperture_rad / 2
    sin_b, cos_b, sin_e, cos_e = np.sin(bearing), np.cos(bearing), np.sin(elevation), np.cos(elevation)
    return RayFan(
        direction=_vectors(cos_e * cos_b, cos_e * sin_b, sin_e),
        column=np.repeat(np.arange(beams), rays_per_beam),
        elevation_rad=elevation.ravel().astype(np.float32),
        solid_angle_sr=(cos_e * step_rad * np.diff(edges)[:, None]).ravel().astype(np.float32),
        elevation_step_rad=step_rad,
    )


def _vectors(x: FloatArray, y: FloatArray, z: FloatArray) -> ImageArray:
    return np.stack([x.ravel(), y.ravel(), z.ravel()]).astype(np.float32)


def turn(rotation: ImageArray, vectors: ImageArray) -> ImageArray:
    """Rotate (3, N) vectors by a (3, 3) matrix, without the threads that a matrix product would wake for it."""
    turned = np.empty_like(vectors)
    for axis, (x, y, z) in enumerate(rotation):
        np.multiply(vectors[0], x, out=turned[axis])
        turned[axis] += y * vectors[1]
        turned[axis] += z * vectors[2]
    return turned


def _read_hits(found: dict[str, NDArray[Any]], origin: ImageArray, ahead: ImageArray, up: ImageArray) -> Hits:
    """Read Embree's answer for rays from ``origin`` along ``ahead``, both (3, N) or (3, 1); ``up`` is (3,)."""
    normal = np.ascontiguousarray(found["Ng"].T)
    unit = 1 / np.sqrt(np.einsum("ij,ij->j", normal, normal) + np.float32(1e-30))
    return Hits(
        range_m=found["tfar"],
        toward=np.einsum("ij,ij->j", normal, ahead) * unit,
        upward=np.einsum("ij,i->j", normal, up) * unit,
        normal=normal,
        unit=unit,
        place_m=ahead * found["tfar"] + origin,
        face=found["primID"],
    )


class RayCaster:
    """A mesh ready for rays. Keeps Embree's acceleration structure; safe to use from several threads."""

    def __init__(self, scene: Scene) -> None:
        """Build the acceleration structure.

        Raises:
            AsfmError: the scene has no faces.
        """
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        if not len(scene.faces):
            raise AsfmError(f"scene {scene.name}: expected a mesh with faces, found none")
        self._scene: Any = EmbreeScene()
        # Embree works in float32: keep the numbers small by moving the scene's middle to the origin.
        self.centre_m: FloatArray = 0.5 * (scene.vertices_m.min(axis=0) + scene.vertices_m.max(axis=0))
        triangles = (scene.vertices_m - self.centre_m)[scene.faces].astype(np.float32)
        self._mesh: Any = TriangleMesh(self._scene, triangles)

    def cast(self, world_from_sonar: FloatArray, direction: ImageArray, farthest_m: float) -> Hits:
        """Find the first surface along each ray from the sonar.

        Args:
            world_from_sonar: (4, 4).
            direction: (3, N) unit vectors of the sonar frame.
            farthest_m: how far to look.
        """
        rotation = world_from_sonar[:3, :3].astype(np.float32)
        start = (world_from_sonar[:3, 3] - self.centre_m).astype(np.float32)
        ahead = turn(rotation, direction)
        origin = np.tile(start, (direction.shape[1], 1))
        found = self.shoot(origin, np.ascontiguousarray(ahead.T), farthest_m)
        return _read_hits(found, start[:, None], ahead, rotation[:, 2])

    def bounce(self, world_from_sonar: FloatArray, hits: Hits, farthest_m: float) -> Hits:
        """Follow every ray on from where it struck, mirrored, to the next surface.

        Ranges run on from the first hit; rays that strike nothing again end at the farthest range.
        """
        start = (world_from_sonar[:3, 3] - self.centre_m).astype(np.float32)[:, None]
        ahead = (hits.place_m - start) / hits.range_m
        ahead -= 2 * hits.toward * hits.unit * hits.normal
        origin = hits.place_m + np.float32(BOUNCE_GAP_M) * ahead
        found = self.shoot(np.ascontiguousarray(origin.T), np.ascontiguousarray(ahead.T), farthest_m)
        found["primID"][hits.face < 0] = -1
        again = _read_hits(found, origin, ahead, world_from_sonar[:3, 2].astype(np.float32))
        return replace(again, range_m=np.where(again.face < 0, farthest_m, hits.range_m + again.range_m))

    def shoot(self, origin: ImageArray, direction: ImageArray, farthest_m: float) -> dict[str, NDArray[Any]]:
        """Run Embree and nothing else: (N, 3) origins and directions, relative to the scene's middle."""
        limit = np.full(len(direction), farthest_m, dtype=np.float32)
        found: dict[str, NDArray[Any]] = self._scene.run(origin, direction, limit, output=True, query="INTERSECT")
        return found
