"""From the sonar's pose to its image, and to the truth behind the image."""

from dataclasses import dataclass, replace

import numpy as np

from asfm.simulation.echo import (
    Echoes,
    EchoStrength,
    accumulate_power,
    average_elevation,
    delay_echoes,
    trace_echoes,
    weigh_echoes,
)
from asfm.simulation.rays import Hits, RayCaster, RayFan, make_ray_fan
from asfm.simulation.receiver import PointSpread, add_noise, leak_beams, make_point_spread, spread_beams, spread_ranges
from asfm.simulation.scene import Scene
from asfm.simulation.sensor import ImagingSonar, make_sonar_model
from asfm.simulation.speckle import FieldBank, make_field_bank
from asfm.sonar import SonarModel
from asfm.types import FloatArray, FrameTruth, ImageArray

BANK_SEED = 2048
"""The bank belongs to the sonar; what a sequence's seed decides is what is drawn from it."""
GAIN_POSES = 3
MIDDLE_VALUE = 0.3
STRONG_VALUE = 0.9


@dataclass(frozen=True)
class Renderer:
    """Everything that turns a pose into an image; it keeps no state and may be used from several threads."""

    scene: Scene
    caster: RayCaster
    sonar: ImagingSonar
    model: SonarModel
    fan: RayFan
    strength: EchoStrength
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
        return spread_beams(self._measure_pulses(echoes), self.spread)

    def display(self, power: ImageArray) -> ImageArray:
        """Turn echo density into image values in 0..1: amplitudes, the strong ones softly limited."""
        return np.asarray(-np.expm1(np.sqrt(power) * np.float32(-self.gain)))

    def render(self, world_from_sonar: FloatArray, hits: Hits, rng: np.random.Generator) -> ImageArray:
        """Give the (ranges, beams) image that the sonar records: echoes, side lobes, second bounces, noise.

        ``hits`` is what :meth:`cast` found from that pose.
        """
        echoes = self.trace(hits)
        if self.sonar.range_sigma:
            echoes = delay_echoes(echoes, self.sonar.range_sigma / self.model.range_step_m, rng)
        pulsed = self._measure_pulses(echoes)
        if self.sonar.multi_path:
            pulsed += self._measure_pulses(self._trace_second_bounce(world_from_sonar, hits))
        power = spread_beams(pulsed, self.spread) + leak_beams(pulsed, self.spread)
        return add_noise(self.display(power), self.sonar, self.model, rng, self.bank)

    def render_truth(self, hits: Hits) -> FrameTruth:
        """Give the elevation of every pixel, and the image of the direct echoes in the main lobes without noise."""
        echoes = self.trace(hits)
        return FrameTruth(average_elevation(echoes, self.model.shape), self.display(self.measure_power(echoes)))

    def _measure_pulses(self, echoes: Echoes) -> ImageArray:
        return spread_ranges(accumulate_power(echoes, self.model.shape), self.spread)

    def _trace_second_bounce(self, world_from_sonar: FloatArray, hits: Hits) -> Echoes:
        """Find the echoes that go sonar, mirror, surface, mirror, sonar: heard behind the mirror, at its bearing."""
        echoes = self.trace(self.caster.bounce(world_from_sonar, hits, self.sonar.range_max))
        return replace(echoes, power=echoes.power * np.float32(10 ** (self.sonar.multi_path_db / 10)))


def make_renderer(scene: Scene, sonar: ImagingSonar, poses: FloatArray) -> Renderer:
    """Prepare to render; the gain, where the sonar leaves it open, is set from three of the (N, 4, 4) poses.

    Raises:
        AsfmError: the scene has no faces.
    """
    model = make_sonar_model(sonar)
    fan = make_ray_fan(model, sonar.elevation_bins)
    strength, spread = weigh_echoes(scene, fan, sonar, model), make_point_spread(sonar, model)
    bank = None if sonar.independent_beams else make_field_bank(spread.lobe, np.random.default_rng(BANK_SEED))
    renderer = Renderer(scene, RayCaster(scene), sonar, model, fan, strength, spread, bank)
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
