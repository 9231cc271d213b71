"""Simulated sequences with ground truth: scene, sonar, trajectory and navigation sensors combined.

Entry points are :func:`simulate` (by name) and :func:`simulate_path` (given a scene and a path).
"""

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
from asfm.simulation.placement_checks import check_distance, check_outside, count_empty_views
from asfm.simulation.scenes.catalogue import find_scene
from asfm.simulation.scenes.scene import Scene
from asfm.simulation.sonars.holoocean_scenario import MountedSonar, read_mounted_sonar
from asfm.simulation.sonars.parameters import ImagingSonar
from asfm.simulation.sonars.presets import find_preset
from asfm.simulation.vehicle.sensors import SlowDrift, simulate_navigation, simulate_odometry
from asfm.simulation.vehicle.trajectories import Motion, View, find_motion
from asfm.types import FloatArray, Frame, FrameTruth, SensorNoise, Trajectory

SENSOR_NOISE = SensorNoise(0.02, float(np.deg2rad(0.3)), 0.01, float(np.deg2rad(0.2)), float(np.deg2rad(0.2)))
"""Standard deviations of a DVL with a gyro (each step between frames), a pressure cell and an attitude sensor."""

SLOW_DRIFT = SlowDrift()
MAX_FRAMES = 1_000_000
"""All poses are computed before the first frame; more would not fit into a laptop's memory."""

_SCENE, _MOTION, _ODOMETRY, _NAVIGATION, _FRAMES = range(5)
"""Independent random streams, so that none depends on how many numbers another has drawn."""


@dataclass(frozen=True)
class SimulatedSequence:
    """A sequence with its ground truth and the renderer. Frames are rendered when they are read."""

    sequence: Sequence
    scene: Scene
    sonar: ImagingSonar
    renderer: Renderer
    read_truth: Callable[[int], FrameTruth]
    """Frame index -> elevation and noise-free image."""


def simulate(
    scene_name: str,
    preset: str = "oculus_m750d_high",
    frame_count: int = 80,
    seed: int = 0,
    motion: str | Trajectory | None = None,
    vehicle_from_sonar: FloatArray | None = None,
    scene_seed: int | None = None,
) -> SimulatedSequence:
    """Simulate a sequence of a scene by name.

    The same arguments give the same bytes, frame by frame, in any order and on any number of threads.

    Args:
        scene_name: key of :data:`asfm.simulation.scenes.catalogue.SCENES`, or a mesh file.
        preset: key of :data:`asfm.simulation.sonars.presets.PRESETS`, or a HoloOcean scenario (.json).
        frame_count: number of frames at the sonar's rate; fewer where a given path ends before.
        seed: seed of all random numbers.
        motion: key of :data:`asfm.simulation.vehicle.trajectories.MOTIONS`, or the path of the vehicle; by default the
            scene's usual motion.
        vehicle_from_sonar: (4, 4) lever arm; by default that of the scenario, or the identity.
        scene_seed: seed of scene and motion; ``seed`` then changes nothing but the noise of images and sensors.

    Raises:
        AsfmError: an unknown name, a file that cannot be read, a sonar inside an object, fewer than one frame or
            more than a million, a negative seed.
    """
    scene_seed = seed if scene_seed is None else scene_seed
    _check_request(frame_count, min(seed, scene_seed))
    mounted = find_sonar(preset)
    mount = mounted.vehicle_from_sonar if vehicle_from_sonar is None else vehicle_from_sonar
    source = find_scene(scene_name)
    move = motion if isinstance(motion, Trajectory) else find_motion(motion or source.motion)
    scene, view = source.build(mounted.sonar.range_max, _generator(scene_seed, _SCENE))
    path, diagnostics = _make_path(move, view, mounted.sonar.rate_hz, frame_count, mount, scene_seed)
    simulated = simulate_path(scene, mounted.sonar, path, seed, mount)
    diagnostics = mounted.diagnostics + diagnostics + simulated.sequence.diagnostics
    return replace(simulated, sequence=replace(simulated.sequence, diagnostics=diagnostics))


def _check_request(frame_count: int, seed: int) -> None:
    if frame_count < 1:
        raise AsfmError(f"expected at least one frame to simulate, found {frame_count}")
    if frame_count > MAX_FRAMES:
        raise AsfmError(f"expected {MAX_FRAMES} frames to simulate at most, found {frame_count}")
    if seed < 0:
        raise AsfmError(f"expected a seed of zero or more, found {seed}")


def _make_path(
    motion: Motion | Trajectory, view: View, rate_hz: float, frame_count: int, mount: FloatArray, seed: int
) -> tuple[Trajectory, tuple[Diagnostic, ...]]:
    """Return the poses of the vehicle at the frames: sampled from its path, or of a motion of the sonar."""
    if not isinstance(motion, Trajectory):
        times_s: FloatArray = np.arange(frame_count) / rate_hz
        return Trajectory(times_s, motion(view, times_s, _generator(seed, _MOTION)) @ invert(mount)), ()
    path = sample_path(motion, rate_hz, frame_count)
    if len(path.timestamps_s) == frame_count:
        return path, ()
    message = f"the path ends after {len(path.timestamps_s)} of {frame_count} frames at {rate_hz:g} Hz"
    return path, (Diagnostic("short-path", message),)


def find_sonar(name: str) -> MountedSonar:
    """Return the sonar of a preset, or of a HoloOcean scenario (.json) with its lever arm.

    Raises:
        AsfmError: there is no such preset, or the scenario cannot be read.
    """
    if name.endswith(".json"):
        return read_mounted_sonar(Path(name))
    return MountedSonar(find_preset(name), np.eye(4))


def sample_path(path: Trajectory, rate_hz: float, frame_count: int) -> Trajectory:
    """Return at most ``frame_count`` poses at an even rate from the beginning of a path, interpolated."""
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

    Args:
        scene: the mesh and its reflectivity.
        sonar: parameters of the sonar.
        path: world_from_vehicle at the time stamps of the frames.
        seed: seed of all random numbers.
        vehicle_from_sonar: (4, 4) lever arm, by default the identity.
        noise: standard deviations of odometry, depth and attitude.
        drift: slowly varying bias of the odometry; None for white noise only.

    Raises:
        AsfmError: the scene is empty, or the sonar would be inside an object or far away from everything.
    """
    mount = np.eye(4) if vehicle_from_sonar is None else vehicle_from_sonar
    poses = path.world_from_vehicle @ mount
    check_distance(scene, poses)
    renderer = make_renderer(scene, sonar, poses)
    check_outside(scene, renderer.caster, poses)
    read_frame, read_truth = _make_frame_readers(renderer, path.timestamps_s, poses, seed)
    sequence = Sequence(scene.name, renderer.model, path.timestamps_s, read_frame, mount, groundtruth=path, noise=noise)
    sequence = replace(sequence, kind="simulated", diagnostics=_diagnose(renderer, poses))
    sequence = add_sensors(sequence, seed, drift)
    return SimulatedSequence(sequence, scene, sonar, renderer, read_truth)


def add_sensors(sequence: Sequence, seed: int, drift: SlowDrift | None = SLOW_DRIFT) -> Sequence:
    """Replace odometry, depth and attitude by those of a seed of :func:`simulate`, along the true poses.

    The noise is the stated one; ``drift`` is the slowly varying bias of the odometry, None for white noise only.
    """
    assert sequence.groundtruth is not None, "sensors are simulated along true poses"
    odometry = simulate_odometry(sequence.groundtruth, sequence.noise, _generator(seed, _ODOMETRY), drift)
    navigation = simulate_navigation(sequence.groundtruth, sequence.noise, _generator(seed, _NAVIGATION))
    return replace(sequence, odometry=odometry, navigation=navigation)


def _make_frame_readers(
    renderer: Renderer, timestamps_s: FloatArray, poses: FloatArray, seed: int
) -> tuple[Callable[[int], Frame], Callable[[int], FrameTruth]]:
    """Return the functions that render frame i, and its truth, from (N, 4, 4) world_from_sonar."""

    @lru_cache(maxsize=1)  # a writer asks for a frame and then for its truth
    def cast(index: int) -> Hits:
        return renderer.cast(poses[index])

    def read_frame(index: int) -> Frame:
        image = renderer.render(cast(index), _generator(seed, _FRAMES, index))
        return Frame(index, float(timestamps_s[index]), image, np.zeros(image.shape, dtype=bool))

    def read_truth(index: int) -> FrameTruth:
        return renderer.render_truth(cast(index))

    return read_frame, read_truth


def _diagnose(renderer: Renderer, poses: FloatArray) -> tuple[Diagnostic, ...]:
    """Return diagnostics on an open mesh, and on frames from which nothing is in view."""
    scene, sonar = renderer.scene, renderer.sonar
    found = []
    if not scene.winds_outward:
        message = f"the mesh of {scene.name} is open: it reflects from both sides and has no interior to avoid"
        found.append(Diagnostic("open-mesh", message))
    empty_count = count_empty_views(renderer.caster, renderer.fan, poses, (sonar.range_min, sonar.range_max))
    if empty_count:
        size_m = float(np.ptp(scene.vertices_m, axis=0).max())
        message = (
            f"{empty_count} of {len(poses)} frames see nothing of {scene.name} within {sonar.range_max} m; "
            f"it is {size_m:.4g} m across"
        )
        found.append(Diagnostic("empty-frames", message))
    return tuple(found)


def _generator(seed: int, *stream: int) -> np.random.Generator:
    """Return the generator of one random stream of a seed."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=stream))
