"""Simulate a sequence: scene, sonar, motion and sensors put together."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from asfm.diagnostics import Diagnostic
from asfm.errors import AsfmError
from asfm.geometry.poses import interpolate, invert
from asfm.sequence import Sequence
from asfm.simulation.acoustics.rays import Hits
from asfm.simulation.acoustics.renderer import Renderer, make_renderer
from asfm.simulation.placement_checks import check_near, check_outside, count_blind
from asfm.simulation.scenes.catalogue import find_scene
from asfm.simulation.scenes.scene import Scene
from asfm.simulation.sonars.holoocean_scenario import MountedSonar, read_mounted_sonar
from asfm.simulation.sonars.parameters import ImagingSonar
from asfm.simulation.sonars.presets import find_preset
from asfm.simulation.vehicle.sensors import SlowDrift, simulate_navigation, simulate_odometry
from asfm.simulation.vehicle.trajectories import find_motion
from asfm.types import FloatArray, Frame, FrameTruth, SensorNoise, Trajectory

SENSOR_NOISE = SensorNoise(0.02, float(np.deg2rad(0.3)), 0.01, float(np.deg2rad(0.2)), float(np.deg2rad(0.2)))
"""A DVL with a gyro, a pressure cell and an attitude sensor, a step between frames."""

SLOW_DRIFT = SlowDrift()
MAX_FRAMES = 1_000_000
"""All poses are worked out before the first frame: more would not fit into a laptop's memory."""

_SCENE, _MOTION, _ODOMETRY, _NAVIGATION, _FRAMES = range(5)
"""Each use of chance has a stream of its own, so that none depends on what was drawn before it."""


@dataclass(frozen=True)
class SimulatedSequence:
    """A sequence with what only a simulation knows. Frames are rendered when they are read."""

    sequence: Sequence
    scene: Scene
    sonar: ImagingSonar
    renderer: Renderer
    read_truth: Callable[[int], FrameTruth]
    """Elevation and noise-free image of frame i."""


def simulate(
    scene_name: str,
    preset: str = "oculus_m750d_high",
    frame_count: int = 80,
    seed: int = 0,
    motion: str | Trajectory | None = None,
    vehicle_from_sonar: FloatArray | None = None,
) -> SimulatedSequence:
    """Simulate a sequence.

    The same arguments give the same bytes, frame by frame, in whatever order and on however many threads they are read.

    Args:
        scene_name: a name of :data:`asfm.simulation.scenes.catalogue.SCENES`, or a mesh file.
        preset: a name of :data:`asfm.simulation.sonars.presets.PRESETS`, or a HoloOcean scenario (.json).
        frame_count: frames at the sonar's rate; fewer where a given path ends before.
        seed: of everything drawn by chance.
        motion: a name of :data:`asfm.simulation.vehicle.trajectories.MOTIONS`, or the vehicle's path; the scene's usual
            motion where not given.
        vehicle_from_sonar: (4, 4) lever arm; the scenario's, or none, where not given.

    Raises:
        AsfmError: an unknown name, a file that cannot be read, a sonar inside an object, fewer than one frame or
            more than a million, a negative seed.
    """
    if frame_count < 1:
        raise AsfmError(f"expected at least one frame to simulate, found {frame_count}")
    if frame_count > MAX_FRAMES:
        raise AsfmError(f"expected {MAX_FRAMES} frames to simulate at most, found {frame_count}")
    if seed < 0:
        raise AsfmError(f"expected a seed of zero or more, found {seed}")
    scenario = find_sonar(preset)
    sonar = scenario.sonar
    recipe = find_scene(scene_name)
    move = find_motion(motion or recipe.motion) if not isinstance(motion, Trajectory) else None
    mount = scenario.vehicle_from_sonar if vehicle_from_sonar is None else vehicle_from_sonar
    scene, view = recipe.build(sonar.range_max, _generator(seed, _SCENE))
    remarks = scenario.diagnostics
    if isinstance(motion, Trajectory):
        path = sample_path(motion, sonar.rate_hz, frame_count)
        if len(path.timestamps_s) < frame_count:
            message = f"the path ends after {len(path.timestamps_s)} of {frame_count} frames at {sonar.rate_hz:g} Hz"
            remarks += (Diagnostic("short-path", message),)
    else:
        assert move is not None
        times_s: FloatArray = np.arange(frame_count) / sonar.rate_hz
        path = Trajectory(times_s, move(view, times_s, _generator(seed, _MOTION)) @ invert(mount))
    simulated = simulate_path(scene, sonar, path, seed, mount)
    return replace(
        simulated, sequence=replace(simulated.sequence, diagnostics=remarks + simulated.sequence.diagnostics)
    )


def find_sonar(name: str) -> MountedSonar:
    """Give the sonar of a preset, or of a HoloOcean scenario with its lever arm.

    Raises:
        AsfmError: no such preset, or a scenario that cannot be read.
    """
    if name.endswith(".json"):
        return read_mounted_sonar(Path(name))
    return MountedSonar(find_preset(name), np.eye(4))


def sample_path(path: Trajectory, rate_hz: float, frame_count: int) -> Trajectory:
    """Take at most so many poses from a path at an even rate, from its beginning."""
    length_s = float(path.timestamps_s[-1] - path.timestamps_s[0])
    count = min(frame_count, int(np.floor(length_s * rate_hz + 1e-6)) + 1)
    times_s = path.timestamps_s[0] + np.arange(count) / rate_hz
    return Trajectory(times_s, interpolate(path.timestamps_s, path.world_from_vehicle, times_s))


def simulate_path(
    scene: Scene,
    sonar: ImagingSonar,
    path: Trajectory,
    seed: int = 0,
    vehicle_from_sonar: FloatArray | None = None,
    noise: SensorNoise = SENSOR_NOISE,
    drift: SlowDrift | None = SLOW_DRIFT,
) -> SimulatedSequence:
    """Simulate a sequence along the path of a vehicle that carries the sonar.

    Raises:
        AsfmError: the scene is empty, or the sonar would be inside an object or far away from everything.
    """
    mount = np.eye(4) if vehicle_from_sonar is None else vehicle_from_sonar
    poses = path.world_from_vehicle @ mount
    check_near(scene, poses)
    renderer = make_renderer(scene, sonar, poses)
    check_outside(scene, renderer.caster, poses)

    @lru_cache(maxsize=1)  # a writer asks for a frame and then for its truth
    def cast(index: int) -> Hits:
        return renderer.cast(poses[index])

    def read_frame(index: int) -> Frame:
        image = renderer.render(cast(index), _generator(seed, _FRAMES, index))
        return Frame(index, float(path.timestamps_s[index]), image, np.zeros(image.shape, dtype=bool))

    sequence = Sequence(
        scene.name,
        renderer.model,
        path.timestamps_s,
        read_frame,
        mount,
        odometry=simulate_odometry(path, noise, _generator(seed, _ODOMETRY), drift),
        navigation=simulate_navigation(path, noise, _generator(seed, _NAVIGATION)),
        groundtruth=path,
        noise=noise,
        kind="simulated",
        diagnostics=_diagnose(renderer, poses),
    )
    return SimulatedSequence(sequence, scene, sonar, renderer, lambda index: renderer.render_truth(cast(index)))


def _diagnose(renderer: Renderer, poses: FloatArray) -> tuple[Diagnostic, ...]:
    scene, sonar = renderer.scene, renderer.sonar
    found = []
    if not scene.winds_outward:
        message = f"the mesh of {scene.name} is open: it reflects from both sides and has no interior to avoid"
        found.append(Diagnostic("open-mesh", message))
    blind = count_blind(renderer.caster, renderer.fan, poses, (sonar.range_min, sonar.range_max))
    if blind:
        size_m = float(np.ptp(scene.vertices_m, axis=0).max())
        message = (
            f"{blind} of {len(poses)} frames see nothing of {scene.name} within {sonar.range_max} m; "
            f"it is {size_m:.4g} m across"
        )
        found.append(Diagnostic("empty-frames", message))
    return tuple(found)


def _generator(seed: int, *stream: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=stream))
