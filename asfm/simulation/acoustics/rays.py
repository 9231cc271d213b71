"""Ray casting with Embree: fan of rays over azimuth and elevation, hits on a mesh, specular bounces."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asfm.errors import AsfmError
from asfm.geometry.sonar import SonarModel
from asfm.simulation.scenes.scene import Scene
from asfm.types import FloatArray, ImageArray, IntArray

GOLDEN_RATIO = 0.6180339887498949
PLASTIC_RATIOS = (0.7548776662466927, 0.5698402909980532)
"""Inverse and inverse square of the plastic number (R2 sequence): shifts of the lattice from beam to beam."""
BOUNCE_OFFSET_M = 1e-3
"""Distance from its surface at which a reflected ray starts, so that it does not hit it again."""


@dataclass(frozen=True)
class RayFan:
    """The N rays of one ping in the sonar frame, ordered by beam."""

    direction: ImageArray
    """(3, N) unit vectors; those of a whole ping are stored ray by ray, as Embree reads them."""
    column: IntArray
    """(N,) beam of the ray."""
    elevation_rad: ImageArray
    """(N,)"""
    solid_angle_sr: ImageArray
    """(N,) solid angle that the ray represents."""
    elevation_step_rad: float
    """Between neighbouring rays of one beam."""

    def part(self, rays: slice, first_beam: int) -> "RayFan":
        """Return some of the rays, with beams numbered from ``first_beam``."""
        return RayFan(
            np.ascontiguousarray(self.direction[:, rays]),
            self.column[rays] - first_beam,
            self.elevation_rad[rays],
            self.solid_angle_sr[rays],
            self.elevation_step_rad,
        )


@dataclass(frozen=True)
class Hits:
    """First hits of N rays; vectors have the axes of the world frame."""

    origin_m: ImageArray
    """(3, N) start of the rays relative to the centre of the scene; (3, 1) where all rays start at one point."""
    direction: ImageArray
    """(3, N) unit vectors along the rays."""
    up: ImageArray
    """(3,) z axis of the sonar."""
    range_m: ImageArray
    """(N,) distance to the hit; the maximum range where nothing was hit."""
    normal: ImageArray
    """(3, N) outward normals of the faces, not normalised; zero where nothing was hit."""
    face: NDArray[np.int32]
    """(N,) index of the face, -1 where nothing was hit."""

    @property
    def cos_incidence(self) -> ImageArray:
        """(N,) cosine between ray and outward normal, negative on front faces; zero where nothing was hit."""
        return compute_incidence(self)[0]

    def part(self, rays: slice) -> "Hits":
        """Return some of the hits, vectors stored by coordinate (Embree stores them ray by ray)."""
        origin_m = self.origin_m if self.origin_m.shape[1] == 1 else self.origin_m[:, rays]
        direction, normal = np.ascontiguousarray(self.direction[:, rays]), np.ascontiguousarray(self.normal[:, rays])
        return Hits(origin_m, direction, self.up, self.range_m[rays], normal, self.face[rays])


def compute_incidence(hits: Hits) -> tuple[ImageArray, ImageArray]:
    """Return the cosines of the outward normal with the ray, and with the z axis of the sonar: (N,) each."""
    scale = _dot(hits.normal, hits.normal)
    scale += np.float32(1e-30)
    np.sqrt(scale, out=scale)
    np.divide(1, scale, out=scale)
    cos_incidence, cos_up = _dot(hits.normal, hits.direction), _dot(hits.normal, hits.up)
    cos_incidence *= scale
    cos_up *= scale
    return cos_incidence, cos_up


def _dot(one: ImageArray, other: ImageArray) -> ImageArray:
    """Return the dot products of (3, N) vectors with (3, N) or (3,) vectors; three times as fast as einsum."""
    total: ImageArray = one[0] * other[0]
    total += one[1] * other[1]
    total += one[2] * other[2]
    return total


def make_ray_fan(sonar: SonarModel, rays_per_beam: int) -> RayFan:
    """Distribute rays evenly over each beam's azimuth interval and the elevation aperture.

    The rays of a beam form a rank-1 lattice (golden ratio across the beam), shifted from beam to beam. A regular grid
    would cause aliasing (moire) at thin objects and at the rows of the image.
    """
    beams = len(sonar.bearing_rad)
    edges = sonar.bearing_edges_rad
    step_rad = sonar.elevation_aperture_rad / rays_per_beam
    ray = np.arange(rays_per_beam)
    beam = np.arange(beams)[:, None]
    across = (GOLDEN_RATIO * (ray + 1) + PLASTIC_RATIOS[0] * beam) % 1.0
    along = (ray + (0.5 + PLASTIC_RATIOS[1] * beam) % 1.0) * step_rad
    bearing = edges[:-1, None] + across * np.diff(edges)[:, None]
    elevation = along - sonar.elevation_aperture_rad / 2
    sin_b, cos_b, sin_e, cos_e = np.sin(bearing), np.cos(bearing), np.sin(elevation), np.cos(elevation)
    return RayFan(
        direction=_stack_vectors(cos_e * cos_b, cos_e * sin_b, sin_e),
        column=np.repeat(np.arange(beams), rays_per_beam),
        elevation_rad=elevation.ravel().astype(np.float32),
        solid_angle_sr=(cos_e * step_rad * np.diff(edges)[:, None]).ravel().astype(np.float32),
        elevation_step_rad=step_rad,
    )


def _stack_vectors(x: FloatArray, y: FloatArray, z: FloatArray) -> ImageArray:
    return np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1).astype(np.float32).T


def aim_rays(rotation: ImageArray, direction: ImageArray) -> ImageArray:
    """Rotate (3, N) vectors by a (3, 3) matrix; returns (N, 3), the layout that Embree expects.

    Uses OpenCV, since numpy's matrix product starts a thread for every core.
    """
    import cv2

    return np.asarray(cv2.transform(np.ascontiguousarray(direction.T)[:, None], rotation)[:, 0], dtype=np.float32)


class RayCaster:
    """A mesh with Embree's acceleration structure; safe to use from several threads."""

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
        # Embree computes in float32: coordinates relative to the centre of the scene keep their precision.
        self.centre_m: FloatArray = 0.5 * (scene.vertices_m.min(axis=0) + scene.vertices_m.max(axis=0))
        triangles = (scene.vertices_m - self.centre_m)[scene.faces].astype(np.float32)
        self._mesh: Any = TriangleMesh(self._scene, triangles)

    def cast(self, world_from_sonar: FloatArray, direction: ImageArray, max_range_m: float) -> Hits:
        """Find the first hit of each ray from the sonar.

        Args:
            world_from_sonar: (4, 4).
            direction: (3, N) unit vectors in the sonar frame.
            max_range_m: hits farther away are ignored.
        """
        rotation = world_from_sonar[:3, :3].astype(np.float32)
        origin = (world_from_sonar[:3, 3] - self.centre_m).astype(np.float32)[:, None]
        return self._cast_from(origin, aim_rays(rotation, direction), rotation[:, 2], max_range_m)

    def bounce(self, hits: Hits, max_range_m: float) -> Hits:
        """Find the second hit of each ray after a specular reflection at its first hit.

        Args:
            hits: the first hits of N rays.
            max_range_m: length of the reflected ray; longer ones are ignored.

        Returns:
            The second hits with the total range; the maximum range where either hit is missing.
        """
        twice = _dot(hits.normal, hits.direction) * np.float32(2)
        twice /= _dot(hits.normal, hits.normal) + np.float32(1e-30)
        reflected: ImageArray = hits.direction - twice * hits.normal
        start: ImageArray = hits.origin_m + hits.range_m * hits.direction
        start += np.float32(BOUNCE_OFFSET_M) * reflected
        second = self._cast_from(start, np.ascontiguousarray(reflected.T), hits.up, max_range_m)
        face = np.where(hits.face < 0, np.int32(-1), second.face)
        range_m = np.where(face < 0, np.float32(max_range_m), hits.range_m + second.range_m)
        # The origin is the mirror image of the sonar, from which a ray of the total range leads to the second surface.
        return replace(second, origin_m=start - hits.range_m * reflected, range_m=range_m, face=face)

    def _cast_from(self, origin_m: ImageArray, direction: ImageArray, up: ImageArray, max_range_m: float) -> Hits:
        """Cast (N, 3) directions from (3, 1) or (3, N) origins."""
        found = self.shoot(np.broadcast_to(origin_m.T, direction.shape), direction, max_range_m)
        return Hits(origin_m, direction.T, up, found["tfar"], found["Ng"].T, found["primID"])

    def shoot(self, origin: ImageArray, direction: ImageArray, max_range_m: float) -> dict[str, NDArray[Any]]:
        """Run Embree on (N, 3) origins and directions, relative to the centre of the scene; returns its raw arrays."""
        limit = np.full(len(direction), max_range_m, dtype=np.float32)
        found: dict[str, NDArray[Any]] = self._scene.run(origin, direction, limit, output=True, query="INTERSECT")
        return found
