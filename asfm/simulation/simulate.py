"""Simulate a sequence: scene, sonar, motion and sensors put together."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from asfm.errors import AsfmError
from asfm.sequence import Sequence
from asfm.simulation.echo import Echoes, accumulate_power, average_elevation, trace_echoes
from asfm.simulation.motions import find_motion
from asfm.simulation.navigation import simulate_navigation, simulate_odometry
from asfm.simulation.presets import find_preset
from asfm.simulation.rays import RayCaster, RayFan, make_ray_fan
from asfm.simulation.receiver import PointSpread, add_noise, make_point_spread, spread_power
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
    spread: PointSpread
    gain: float = 1.0

    def trace(self, world_from_sonar: FloatArray) -> Echoes:
        """Find all echoes of one ping."""
        hits = self.caster.cast(world_from_sonar, self.fan.direction)
        return trace_echoes(hits, self.fan, self.scene, self.sonar, self.model)

    def amplitude(self, echoes: Echoes) -> ImageArray:
        """Give the (ranges, beams) root of the echo density, as the receiver smears it."""
        return np.sqrt(spread_power(accumulate_power(echoes, self.model.shape), self.spread))

    def render(self, echoes: Echoes) -> ImageArray:
        """Give the (ranges, beams) image without noise in 0..1; the receiver limits strong echoes softly."""
        return np.asarray(-np.expm1(self.amplitude(echoes) * np.float32(-self.gain)))


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
        clean = renderer.render(renderer.trace(poses[index]))
        image = add_noise(clean, sonar, renderer.model, _generator(seed, _FRAMES, index))
        return Frame(index, float(path.timestamps_s[index]), image, np.zeros(image.shape, dtype=bool))

    def read_truth(index: int) -> FrameTruth:
        echoes = renderer.trace(poses[index])
        return FrameTruth(average_elevation(echoes, renderer.model.shape), renderer.render(echoes))

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
    return SimulatedSequence(sequence, scene, renderer, read_truth)


def make_renderer(scene: Scene, sonar: ImagingSonar, poses: FloatArray) -> Renderer:
    """Prepare to render, with the gain set, where the sonar leaves it open, from three of the (N, 4, 4) poses."""
    model = make_sonar_model(sonar)
    fan = make_ray_fan(model, sonar.elevation_bins)
    renderer = Renderer(scene, RayCaster(scene), sonar, model, fan, make_point_spread(sonar, model), sonar.gain or 1.0)
    if sonar.gain is not None:
        return renderer
    sample = poses[np.unique(np.linspace(0, len(poses) - 1, 3).round().astype(int))]
    echo = np.concatenate([renderer.amplitude(renderer.trace(pose)).ravel() for pose in sample])
    echo = echo[echo > 0.02 * max(echo.max(), 1e-12)]
    if not len(echo):
        return renderer
    middle, strong = np.quantile(echo, [0.5, 0.9])
    return replace(renderer, gain=min(0.3 / float(middle), 0.9 / float(strong)))


def _generator(seed: int, *stream: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=stream))
