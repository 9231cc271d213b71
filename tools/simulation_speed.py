"""Time the simulator against Embree alone, which casts the same rays in the same run.

Run as ``python tools/simulation_speed.py [SCENE] [--sonar PRESET] [--threads N]``. Frames and bare ray casts take
turns, so that a busy machine slows both alike; what counts is the ratio of the medians.
"""

import argparse
import statistics
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from asfm.simulation.rays import turn
from asfm.simulation.renderer import Renderer
from asfm.simulation.simulate import simulate
from asfm.types import FloatArray, ImageArray

FRAMES = 20
ROUNDS = 7


def prepare_rays(renderer: Renderer, poses: FloatArray) -> list[tuple[ImageArray, ImageArray]]:
    """Give Embree's own input for every pose, so that nothing but Embree is timed."""
    rays = []
    for pose in poses:
        ahead = turn(pose[:3, :3].astype(np.float32), renderer.fan.direction)
        start = (pose[:3, 3] - renderer.caster.centre_m).astype(np.float32)
        rays.append((np.tile(start, (ahead.shape[1], 1)), np.ascontiguousarray(ahead.T)))
    return rays


def time_once(work: Callable[[int], object], pool: ThreadPoolExecutor) -> float:
    """Seconds a frame."""
    begin = time.perf_counter()
    list(pool.map(work, range(FRAMES)))
    return (time.perf_counter() - begin) / FRAMES


def main(arguments: Sequence[str] | None = None) -> None:
    """Print frames a second, million rays a second, and the share of Embree's own rate."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", default="seafloor")
    parser.add_argument("--sonar", default="oculus_m750d_high")
    parser.add_argument("--threads", type=int, default=1)
    chosen = parser.parse_args(arguments)
    simulated = simulate(chosen.scene, chosen.sonar, FRAMES)
    renderer, truth = simulated.renderer, simulated.sequence.groundtruth
    assert truth is not None
    rays = prepare_rays(renderer, truth.world_from_vehicle)
    bare_s, frame_s = [], []
    with ThreadPoolExecutor(chosen.threads) as pool:
        for _ in range(ROUNDS):
            bare_s.append(time_once(lambda i: renderer.caster.shoot(*rays[i], simulated.sonar.range_max), pool))
            frame_s.append(time_once(simulated.sequence.read_frame, pool))
    bare, frame = statistics.median(bare_s), statistics.median(frame_s)
    count = len(renderer.fan.column)
    beams = renderer.model.shape[1]
    faces = len(simulated.scene.faces)
    print(f"{chosen.scene}: {faces} faces, {beams} beams x {count // beams} rays, {chosen.threads} threads")
    print(f"frames      {1 / frame:7.1f} a second  {count / frame / 1e6:6.2f} million rays a second")
    print(f"Embree bare {1 / bare:7.1f} a second  {count / bare / 1e6:6.2f} million rays a second")
    print(f"share of Embree's rate {bare / frame:.2f}")


if __name__ == "__main__":
    main()
