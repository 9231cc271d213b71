"""Sonar image renderer: pose to image, and to the ground truth of elevation and noise-free image."""

from dataclasses import dataclass, replace
from threading import Lock

import numpy as np

from asfm.geometry.sonar import SonarModel
from asfm.simulation.acoustics.accumulation import accumulate_power, average_elevation
from asfm.simulation.acoustics.backscatter import EchoStrength, make_echo_strength
from asfm.simulation.acoustics.correlated_fields import FieldBank, make_field_bank
from asfm.simulation.acoustics.echoes import Echoes, delay_echoes, trace_echoes
from asfm.simulation.acoustics.noise import add_noise
from asfm.simulation.acoustics.rays import Hits, RayCaster, RayFan, make_ray_fan
from asfm.simulation.acoustics.receiver import (
    PointSpread,
    leak_beams,
    make_point_spread,
    spread_beams,
    spread_ranges,
    sum_beams,
)
from asfm.simulation.scenes.scene import Scene
from asfm.simulation.sonars.parameters import ImagingSonar, make_sonar_model
from asfm.types import FloatArray, FrameTruth, ImageArray

BANK_SEED = 2048
"""The bank of fields is the same for all sequences; their seeds decide what is drawn from it."""
GAIN_POSES = 3
"""Number of poses from which the gain is determined."""
MEDIAN_ECHO_VALUE = 0.3
STRONG_ECHO_VALUE = 0.9
"""Largest amplitude times gain of the median and of the 90 % quantile of the echoes at the automatic gain."""

SECTOR_RAYS = 28_000
"""Approximate number of rays traced at once: they stay in the processor's cache, which is twice as fast."""

RENDER_LOCK = Lock()
"""Held by the one thread that turns hits into an image while others cast rays. Embree releases the interpreter lock,
numpy's many short operations do not: two threads that compete for it are slower than one after the other."""


@dataclass(frozen=True)
class Sector:
    """Adjacent beams whose rays are traced at once."""

    beams: slice
    rays: slice
    fan: RayFan
    strength: EchoStrength


@dataclass(frozen=True)
class Renderer:
    """Scene, rays and receiver of one sonar; immutable, may be used from several threads."""

    scene: Scene
    caster: RayCaster
    sonar: ImagingSonar
    model: SonarModel
    fan: RayFan
    strength: EchoStrength
    sectors: tuple[Sector, ...]
    spread: PointSpread
    bank: FieldBank | None
    """Fields from which speckle and noise are drawn; None where beams are independent."""
    gain: float = 1.0

    def cast(self, world_from_sonar: FloatArray) -> Hits:
        """Return the first hits of all rays of one ping from a (4, 4) pose."""
        return self.caster.cast(world_from_sonar, self.fan.direction, self.sonar.range_max)

    def trace(self, hits: Hits) -> Echoes:
        """Return the direct echoes of the hits of one ping."""
        return trace_echoes(hits, self.fan, self.strength, self.model)

    def compute_power(self, echoes: Echoes) -> ImageArray:
        """Return the (ranges, beams) echo density received by the main lobes."""
        pulsed = spread_ranges(accumulate_power(echoes, self.model.shape[::-1]), self.spread)
        return np.ascontiguousarray(spread_beams(pulsed, self.spread).T)

    def display(self, power: ImageArray) -> ImageArray:
        """Turn (ranges, beams) echo density into image values in 0..1: 1 - exp(-gain * amplitude), a soft limit."""
        value: ImageArray = np.sqrt(power)
        value *= np.float32(-self.gain)
        return np.negative(np.expm1(value, out=value), out=value)

    def render(self, hits: Hits, rng: np.random.Generator) -> ImageArray:
        """Render the (ranges, beams) image: echoes, side lobes, second bounces and noise.

        Args:
            hits: result of :meth:`cast` for the pose of the ping.
            rng: source of the noise.
        """
        ghosts = self.caster.bounce(hits, self.sonar.range_max) if self.sonar.multi_path else None
        with RENDER_LOCK:
            pulsed = self._accumulate_sectors(hits, rng)
            if ghosts is not None:
                pulsed += self._accumulate_sectors(ghosts) * np.float32(10 ** (self.sonar.multi_path_db / 10))
            return add_noise(self._receive(pulsed), self.sonar, self.model, rng, self.bank)

    def _receive(self, pulsed: ImageArray) -> ImageArray:
        """Return the noise-free (ranges, beams) image of a (beams, ranges) echo density: main and side lobes."""
        total = sum_beams(pulsed, self.spread)
        image = np.empty(self.model.shape, dtype=np.float32)
        for sector in self.sectors:
            power = leak_beams(total, self.spread, sector.beams)
            power += spread_beams(pulsed, self.spread, sector.beams)
            image[:, sector.beams] = self.display(power).T
        return image

    def render_truth(self, hits: Hits) -> FrameTruth:
        """Return the elevation of every pixel, and the noise-free image of the direct echoes in the main lobes."""
        echoes = self.trace(hits)
        return FrameTruth(average_elevation(echoes, self.model.shape), self.display(self.compute_power(echoes)))

    def _accumulate_sectors(self, hits: Hits, rng: np.random.Generator | None = None) -> ImageArray:
        """Return the (beams, ranges) echo density before the beam pattern; with a generator, echoes are delayed."""
        rows, beams = self.model.shape
        pulsed = np.empty((beams, rows), dtype=np.float32)
        for sector in self.sectors:
            echoes = trace_echoes(hits.part(sector.rays), sector.fan, sector.strength, self.model)
            if rng and self.sonar.range_sigma:
                echoes = delay_echoes(echoes, self.sonar.range_sigma / self.model.range_step_m, rng)
            shape = (sector.beams.stop - sector.beams.start, rows)
            pulsed[sector.beams] = spread_ranges(accumulate_power(echoes, shape), self.spread)
        return pulsed


def divide_into_sectors(fan: RayFan, strength: EchoStrength, beams: int) -> tuple[Sector, ...]:
    """Divide the rays into sectors of adjacent beams with about SECTOR_RAYS rays each."""
    rays_per_beam = len(fan.column) // beams
    width = max(1, SECTOR_RAYS // rays_per_beam)
    sectors = []
    for first in range(0, beams, width):
        last = min(first + width, beams)
        rays = slice(first * rays_per_beam, last * rays_per_beam)
        sectors.append(Sector(slice(first, last), rays, fan.part(rays, first), strength.part(rays)))
    return tuple(sectors)


def make_renderer(scene: Scene, sonar: ImagingSonar, poses: FloatArray) -> Renderer:
    """Prepare the renderer of a sonar in a scene.

    Args:
        scene: the mesh and its reflectivity.
        sonar: parameters; a gain that is not given is set from three of the poses.
        poses: (N, 4, 4) world_from_sonar.

    Raises:
        AsfmError: the scene has no faces.
    """
    model = make_sonar_model(sonar)
    fan = make_ray_fan(model, sonar.elevation_bins)
    strength, spread = make_echo_strength(scene, fan, sonar, model), make_point_spread(sonar, model)
    bank = None if sonar.independent_beams else make_field_bank(spread.lobe, np.random.default_rng(BANK_SEED))
    sectors = divide_into_sectors(fan, strength, model.shape[1])
    renderer = Renderer(scene, RayCaster(scene), sonar, model, fan, strength, sectors, spread, bank)
    return replace(renderer, gain=sonar.gain or _choose_gain(renderer, poses))


def _choose_gain(renderer: Renderer, poses: FloatArray) -> float:
    """Choose the gain such that the median echo is dark grey and 90 % of the echoes are below saturation."""
    sample = poses[np.unique(np.linspace(0, len(poses) - 1, GAIN_POSES).round().astype(int))]
    echo = np.concatenate(
        [np.sqrt(renderer.compute_power(renderer.trace(renderer.cast(pose)))).ravel() for pose in sample]
    )
    echo = echo[echo > 0.02 * max(float(echo.max()), 1e-12)]
    if not len(echo):
        return 1.0
    middle, strong = np.quantile(echo, [0.5, 0.9])
    return min(MEDIAN_ECHO_VALUE / float(middle), STRONG_ECHO_VALUE / float(strong))
