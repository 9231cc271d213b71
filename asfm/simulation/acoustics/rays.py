"""Rays over azimuth and elevation, and where they strike a mesh (Embree)."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asfm.errors import AsfmError
from asfm.geometry.sonar import SonarModel
from asfm.simulation.scenes.scene import Scene
from asfm.types import FloatArray, ImageArray, IntArray

GOLDEN = 0.6180339887498949
BOUNCE_GAP_M = 1e-3
"""How far a mirrored ray starts off its surface, so that it does not strike it again."""


@dataclass(frozen=True)
class RayFan:
    """The N rays of one ping in the sonar frame, beam after beam; they do not change with the pose."""

    direction: ImageArray
    """(3, N) unit vectors; those of a whole ping lie in memory ray after ray, as Embree reads them."""
    column: IntArray
    """(N,) beam that hears the ray."""
    elevation_rad: ImageArray
    """(N,)"""
    solid_angle_sr: ImageArray
    """(N,) that the ray stands for."""
    elevation_step_rad: float
    """Between neighbours of one beam."""

    def part(self, rays: slice, first_beam: int) -> "RayFan":
        """Give some of the rays, their beams counted from ``first_beam``."""
        return RayFan(
            np.ascontiguousarray(self.direction[:, rays]),
            self.column[rays] - first_beam,
            self.elevation_rad[rays],
            self.solid_angle_sr[rays],
            self.elevation_step_rad,
        )


@dataclass(frozen=True)
class Hits:
    """What each of N rays struck first, as Embree tells it; vectors have the world's directions."""

    origin_m: ImageArray
    """(3, N) relative to the scene's middle; (3, 1) where all rays start from one place."""
    ahead: ImageArray
    """(3, N) unit vectors along the rays."""
    up: ImageArray
    """(3,) the sonar's z axis."""
    range_m: ImageArray
    """(N,), the farthest range where nothing was struck."""
    normal: ImageArray
    """(3, N) outward normals of the faces, of any length; zero where nothing was struck."""
    face: NDArray[np.int32]
    """(N,) index of the face, -1 where nothing was struck."""

    @property
    def toward(self) -> ImageArray:
        """(N,) cosine between the ray and the outward normal, negative in front; zero where nothing was struck."""
        return measure_incidence(self)[0]

    def part(self, rays: slice) -> "Hits":
        """Give some of the hits, each coordinate by itself in memory: Embree's vectors lie one after another."""
        origin_m = self.origin_m if self.origin_m.shape[1] == 1 else self.origin_m[:, rays]
        ahead, normal = np.ascontiguousarray(self.ahead[:, rays]), np.ascontiguousarray(self.normal[:, rays])
        return Hits(origin_m, ahead, self.up, self.range_m[rays], normal, self.face[rays])


def measure_incidence(hits: Hits) -> tuple[ImageArray, ImageArray]:
    """Give the cosines between outward normal and ray, and between outward normal and the sonar's z axis: (N,) each."""
    unit = _dot(hits.normal, hits.normal)
    unit += np.float32(1e-30)
    np.sqrt(unit, out=unit)
    np.divide(1, unit, out=unit)
    toward, upward = _dot(hits.normal, hits.ahead), _dot(hits.normal, hits.up)
    toward *= unit
    upward *= unit
    return toward, upward


def _dot(one: ImageArray, other: ImageArray) -> ImageArray:
    """Multiply (3, N) vectors with (3, N) vectors or a (3,) vector; three times as fast as einsum."""
    total: ImageArray = one[0] * other[0]
    total += one[1] * other[1]
    total += one[2] * other[2]
    return total


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
    return np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1).astype(np.float32).T


def aim_rays(rotation: ImageArray, direction: ImageArray) -> ImageArray:
    """Rotate (3, N) vectors by a (3, 3) matrix; the result is (N, 3), as Embree wants it.

    OpenCV's product, since numpy's would wake a thread for every core.
    """
    import cv2

    return np.asarray(cv2.transform(np.ascontiguousarray(direction.T)[:, None], rotation)[:, 0], dtype=np.float32)


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
        origin = (world_from_sonar[:3, 3] - self.centre_m).astype(np.float32)[:, None]
        return self._follow(origin, aim_rays(rotation, direction), rotation[:, 2], farthest_m)

    def bounce(self, hits: Hits, farthest_m: float) -> Hits:
        """Follow every ray on from where it struck, mirrored, to the next surface.

        Ranges run on from the first hit; rays that strike nothing again end at the farthest range.
        """
        twice = _dot(hits.normal, hits.ahead) * np.float32(2)
        twice /= _dot(hits.normal, hits.normal) + np.float32(1e-30)
        ahead: ImageArray = hits.ahead - twice * hits.normal
        start: ImageArray = hits.origin_m + hits.range_m * hits.ahead
        start += np.float32(BOUNCE_GAP_M) * ahead
        again = self._follow(start, np.ascontiguousarray(ahead.T), hits.up, farthest_m)
        face = np.where(hits.face < 0, np.int32(-1), again.face)
        range_m = np.where(face < 0, np.float32(farthest_m), hits.range_m + again.range_m)
        # The mirror image of the sonar, from which a ray of the whole range leads to the second surface.
        return replace(again, origin_m=start - hits.range_m * ahead, range_m=range_m, face=face)

    def _follow(self, origin_m: ImageArray, ahead: ImageArray, up: ImageArray, farthest_m: float) -> Hits:
        """Run Embree for origins of (3, 1) or (3, N) and directions of (N, 3)."""
        found = self.shoot(np.broadcast_to(origin_m.T, ahead.shape), ahead, farthest_m)
        return Hits(origin_m, ahead.T, up, found["tfar"], found["Ng"].T, found["primID"])

    def shoot(self, origin: ImageArray, direction: ImageArray, farthest_m: float) -> dict[str, NDArray[Any]]:
        """Run Embree and nothing else: (N, 3) origins and directions, relative to the scene's middle."""
        limit = np.full(len(direction), farthest_m, dtype=np.float32)
        found: dict[str, NDArray[Any]] = self._scene.run(origin, direction, limit, output=True, query="INTERSECT")
        return found
