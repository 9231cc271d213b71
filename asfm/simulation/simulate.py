"""Simulate a sequence: scene, sonar, motion and sensors put together."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from asfm.errors import AsfmError
from asfm.sequence import Sequence
from asfm.simulation.echo import Echoes, EchoStrength, accumulate_power, average_elevation, trace_echoes, weigh_echoes
from asfm.simulation.motions import find_motion
from asfm.simulation.navigation import simulate_navigation, simulate_odometry
from asfm.simulation.presets import find_preset
from asfm.simulation.rays import RayCaster, RayFan, make_ray_fan
from asfm.simulation.receiver import PointSpread, add_noise, leak_beams, make_point_spread, spread_beams, spread_ranges
from asfm.simulation.scene import Scene
from asfm.simulation.scenes import find_scene
from asfm.simulation.sensor import ImagingSonar, make_sonar_model
from asfm.sonar import SonarModel
from asfm.types import FloatArray, Frame, FrameTruth, ImageArray, SensorNoise, Trajectory

SENSOR_NOISE = SensorNoise(0.02, float(np.deg2rad(0.3)), 0.01, float(np.deg2rad(0.2)), float(np.deg2rad(0.2)))
"""A DVL with a gyro, a pressure cell and an attitude sensor, at five steps a second."""

_SCENE, _MOTION, _ODOMETRY, _NAVIGATION, _FRAMES = range(5)
"""Each use of chance has a stream of its own, so that none depends on what was drawn before it."""


@dataclass(frozen=True)
class Renderer:
    """Everything that turns a pose into an image."""

    scene: Scene
    caster: RayCaster
    sonar: ImagingSonar
    model: SonarModel
    fan: RayFan
    strength: EchoStrength
    spread: PointSpread
    gain: float = 1.0

    def trace(self, world_from_sonar: FloatArray) -> Echoes:
        """Find all echoes of one ping."""
        hits = self.caster.cast(world_from_sonar, self.fan.direction, self.sonar.range_max)
        return trace_echoes(hits, self.fan, self.strength, self.model)

    def measure_power(self, echoes: Echoes) -> tuple[ImageArray, ImageArray]:
        """Give the (ranges, beams) echo density as the main lobes hear it, and what leaks into the beams besides."""
        pulsed = spread_ranges(accumulate_power(echoes, self.model.shape), self.spread)
        return spread_beams(pulsed, self.spread), leak_beams(pulsed, self.spread)

    def display(self, power: ImageArray) -> ImageArray:
        """Turn echo density into image values in 0..1: amplitudes, the strong ones softly limited."""
        return np.asarray(-np.expm1(np.sqrt(power) * np.float32(-self.gain)))

    def render(self, world_from_sonar: FloatArray, rng: np.random.Generator) -> ImageArray:
        """Give the (ranges, beams) image that the sonar records."""
        heard, leaked = self.measure_power(self.trace(world_from_sonar))
        return add_noise(self.display(heard + leaked), self.sonar, self.model, rng)

    def render_truth(self, world_from_sonar: FloatArray) -> FrameTruth:
        """Give the elevation of every pixel and the image without noise, side lobes and cross-talk."""
        echoes = self.trace(world_from_sonar)
        clean = self.display(self.measure_power(echoes)[0])
        return FrameTruth(average_elevation(echoes, self.model.shape), clean)


@dataclass(frozen=True)
class SimulatedSequence:
    """A sequence with what only a simulation knows. Frames are rendered when they are read."""

    sequence: Sequence
    scene: Scene
    renderer: Renderer
    read_truth: Callable[[int], FrameTruth]
    """Elevation and noise-free image of frame i."""


def simulate(
    scene_name: str,
    preset: str = "oculus_m750d_high",
    frame_count: int = 80,
    seed: int = 0,
    motion: str | None = None,
) -> SimulatedSequence:
    """Simulate a sequence of a scene by name.

    The same arguments give the same bytes, frame by frame, in whatever order and on however many threads they are read.

    Raises:
        AsfmError: an unknown scene, preset or motion; fewer than one frame; a negative seed.
    """
    if frame_count < 1:
        raise AsfmError(f"expected at least one frame to simulate, found {frame_count}")
    if seed < 0:
        raise AsfmError(f"expected a seed of zero or more, found {seed}")
    sonar = find_preset(preset)
    recipe = find_scene(scene_name)
    move = find_motion(motion or recipe.motion)
    scene = recipe.make(_generator(seed, _SCENE))
    times_s: FloatArray = np.arange(frame_count) / sonar.rate_hz
    poses = move(recipe.view(sonar.range_max), times_s, _generator(seed, _MOTION))
    return simulate_path(scene, sonar, Trajectory(times_s, poses), seed)


def simulate_path(scene: Scene, sonar: ImagingSonar, path: Trajectory, seed: int = 0) -> SimulatedSequence:
    """Simulate a sequence along a path of the vehicle; the sonar sits in the vehicle's origin."""
    renderer = make_renderer(scene, sonar, path.world_from_vehicle)
    poses = path.world_from_vehicle

    def read_frame(index: int) -> Frame:
        image = renderer.render(poses[index], _generator(seed, _FRAMES, index))
        return Frame(index, float(path.timestamps_s[index]), image, np.zeros(image.shape, dtype=bool))

    sequence = Sequence(
        scene.name,
        renderer.model,
        path.timestamps_s,
        read_frame,
        odometry=simulate_odometry(path, SENSOR_NOISE, _generator(seed, _ODOMETRY)),
        navigation=simulate_navigation(path, SENSOR_NOISE, _generator(seed, _NAVIGATION)),
        groundtruth=path,
        noise=SENSOR_NOISE,
        kind="simulated",
    )
    return SimulatedSequence(sequence, scene, renderer, lambda index: renderer.render_truth(poses[index]))


def make_renderer(scene: Scene, sonar: ImagingSonar, poses: FloatArray) -> Renderer:
    """Prepare to render, with the gain set, where the sonar leaves it open, from three of the (N, 4, 4) poses."""
    model = make_sonar_model(sonar)
    fan = make_ray_fan(model, sonar.elevation_bins)
    strength, spread = weigh_echoes(scene, fan, sonar, model), make_point_spread(sonar, model)
    renderer = Renderer(scene, RayCaster(scene), sonar, model, fan, strength, spread, sonar.gain or 1.0)
    if sonar.gain is not None:
        return renderer
    sample = poses[np.unique(np.linspace(0, len(poses) - 1, 3).round().astype(int))]
    echo = np.concatenate([np.sqrt(renderer.measure_power(renderer.trace(pose))[0]).ravel() for pose in sample])
    echo = echo[echo > 0.02 * max(echo.max(), 1e-12)]
    if not len(echo):
        return renderer
    middle, strong = np.quantile(echo, [0.5, 0.9])
    return replace(renderer, gain=min(0.3 / float(middle), 0.9 / float(strong)))


def _generator(seed: int, *stream: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=stream))
