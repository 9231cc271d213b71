"""From the sonar's pose to its image, and to the truth behind the image."""

from dataclasses import dataclass, replace
from threading import Lock

import numpy as np

from asfm.geometry.sonar import SonarModel
from asfm.simulation.acoustics.accumulation import accumulate_power, average_elevation
from asfm.simulation.acoustics.backscatter import EchoStrength, weigh_echoes
from asfm.simulation.acoustics.correlated_fields import FieldBank, make_field_bank
from asfm.simulation.acoustics.echoes import Echoes, delay_echoes, trace_echoes
from asfm.simulation.acoustics.rays import Hits, RayCaster, RayFan, make_ray_fan
from asfm.simulation.acoustics.receiver import (
    PointSpread,
    add_noise,
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
"""The bank belongs to the sonar; what a sequence's seed decides is what is drawn from it."""
GAIN_POSES = 3
MIDDLE_VALUE = 0.3
STRONG_VALUE = 0.9


SECTOR_RAYS = 28_000
"""About as many rays are traced at once: their numbers stay in the processor's cache, which is twice as fast."""

TURN = Lock()
"""Held by the one thread that turns hits into an image while others cast rays. Embree needs no interpreter, but numpy's
many short steps do: two threads that fight for it at every step lose more than what they could do side by side."""


@dataclass(frozen=True)
class Sector:
    """Neighbouring beams whose rays are traced at once."""

    beams: slice
    rays: slice
    fan: RayFan
    strength: EchoStrength


@dataclass(frozen=True)
class Renderer:
    """Everything that turns a pose into an image; it keeps no state and may be used from several threads."""

    scene: Scene
    caster: RayCaster
    sonar: ImagingSonar
    model: SonarModel
    fan: RayFan
    strength: EchoStrength
    sectors: tuple[Sector, ...]
    spread: PointSpread
    bank: FieldBank | None
    """Fields from which speckle and noise are drawn, where beams do not hear independently."""
    gain: float = 1.0

    def cast(self, world_from_sonar: FloatArray) -> Hits:
        """Find what all rays of one ping strike."""
        return self.caster.cast(world_from_sonar, self.fan.direction, self.sonar.range_max)

    def trace(self, hits: Hits) -> Echoes:
        """Turn what the rays of one ping struck into its direct echoes."""
        return trace_echoes(hits, self.fan, self.strength, self.model)

    def measure_power(self, echoes: Echoes) -> ImageArray:
        """Give the (ranges, beams) echo density as the main lobes hear it."""
        pulsed = spread_ranges(accumulate_power(echoes, self.model.shape[::-1]), self.spread)
        return np.ascontiguousarray(spread_beams(pulsed, self.spread).T)

    def display(self, power: ImageArray) -> ImageArray:
        """Turn echo density into image values in 0..1: amplitudes, the strong ones softly limited."""
        value: ImageArray = np.sqrt(power)
        value *= np.float32(-self.gain)
        return np.negative(np.expm1(value, out=value), out=value)

    def render(self, hits: Hits, rng: np.random.Generator) -> ImageArray:
        """Give the (ranges, beams) image that the sonar records: echoes, side lobes, second bounces, noise.

        ``hits`` is what :meth:`cast` found from the pose of the ping.
        """
        ghosts = self.caster.bounce(hits, self.sonar.range_max) if self.sonar.multi_path else None
        with TURN:
            pulsed = self._measure_sectors(hits, rng)
            if ghosts is not None:
                pulsed += self._measure_sectors(ghosts) * np.float32(10 ** (self.sonar.multi_path_db / 10))
            return add_noise(self._hear(pulsed), self.sonar, self.model, rng, self.bank)

    def _hear(self, pulsed: ImageArray) -> ImageArray:
        """Give the (ranges, beams) image without noise of a (beams, ranges) echo density: main and side lobes."""
        total = sum_beams(pulsed, self.spread)
        image = np.empty(self.model.shape, dtype=np.float32)
        for sector in self.sectors:
            power = leak_beams(total, self.spread, sector.beams)
            power += spread_beams(pulsed, self.spread, sector.beams)
            image[:, sector.beams] = self.display(power).T
        return image

    def render_truth(self, hits: Hits) -> FrameTruth:
        """Give the elevation of every pixel, and the image of the direct echoes in the main lobes without noise."""
        echoes = self.trace(hits)
        return FrameTruth(average_elevation(echoes, self.model.shape), self.display(self.measure_power(echoes)))

    def _measure_sectors(self, hits: Hits, rng: np.random.Generator | None = None) -> ImageArray:
        """Give the (beams, ranges) echo density before the beams smear it; with chance, echoes may be delayed."""
        rows, beams = self.model.shape
        pulsed = np.empty((beams, rows), dtype=np.float32)
        for sector in self.sectors:
            echoes = trace_echoes(hits.part(sector.rays), sector.fan, sector.strength, self.model)
            if rng and self.sonar.range_sigma:
                echoes = delay_echoes(echoes, self.sonar.range_sigma / self.model.range_step_m, rng)
            shape = (sector.beams.stop - sector.beams.start, rows)
            pulsed[sector.beams] = spread_ranges(accumulate_power(echoes, shape), self.spread)
        return pulsed


def cut_sectors(fan: RayFan, strength: EchoStrength, beams: int) -> tuple[Sector, ...]:
    """Cut the rays of all beams into sectors, always the same ones for the same sonar."""
    rays_per_beam = len(fan.column) // beams
    width = max(1, SECTOR_RAYS // rays_per_beam)
    sectors = []
    for first in range(0, beams, width):
        last = min(first + width, beams)
        rays = slice(first * rays_per_beam, last * rays_per_beam)
        sectors.append(Sector(slice(first, last), rays, fan.part(rays, first), strength.part(rays)))
    return tuple(sectors)


def make_renderer(scene: Scene, sonar: ImagingSonar, poses: FloatArray) -> Renderer:
    """Prepare to render; the gain, where the sonar leaves it open, is set from three of the (N, 4, 4) poses.

    Raises:
        AsfmError: the scene has no faces.
    """
    model = make_sonar_model(sonar)
    fan = make_ray_fan(model, sonar.elevation_bins)
    strength, spread = weigh_echoes(scene, fan, sonar, model), make_point_spread(sonar, model)
    bank = None if sonar.independent_beams else make_field_bank(spread.lobe, np.random.default_rng(BANK_SEED))
    sectors = cut_sectors(fan, strength, model.shape[1])
    renderer = Renderer(scene, RayCaster(scene), sonar, model, fan, strength, sectors, spread, bank)
    return replace(renderer, gain=sonar.gain or _choose_gain(renderer, poses))


def _choose_gain(renderer: Renderer, poses: FloatArray) -> float:
    """Set the gain as an operator would: the middle echo is dark grey and nine in ten are below the limit."""
    sample = poses[np.unique(np.linspace(0, len(poses) - 1, GAIN_POSES).round().astype(int))]
    echo = np.concatenate(
        [np.sqrt(renderer.measure_power(renderer.trace(renderer.cast(pose)))).ravel() for pose in sample]
    )
    echo = echo[echo > 0.02 * max(float(echo.max()), 1e-12)]
    if not len(echo):
        return 1.0
    middle, strong = np.quantile(echo, [0.5, 0.9])
    return min(MIDDLE_VALUE / float(middle), STRONG_VALUE / float(strong))
