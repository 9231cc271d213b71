"""Speed of the simulator beside that of Embree alone, which casts the same rays in the same run.

Run as ``python -m tools.benchmark.simulator [SCENE | all] [--sonar PRESET] [--threads N ...]``. Frames and bare ray
casts alternate, so that a busy machine slows both alike; the ratio of the medians is the result.
"""

import argparse
import statistics
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from asfm.simulation.acoustics.rays import aim_rays
from asfm.simulation.acoustics.renderer import Renderer
from asfm.simulation.scenes.catalogue import SCENES
from asfm.simulation.simulate import SimulatedSequence, simulate
from asfm.types import FloatArray, ImageArray

FRAMES = 20
ROUNDS = 7


def prepare_rays(renderer: Renderer, poses: FloatArray) -> list[tuple[ImageArray, ImageArray]]:
    """Return Embree's input, origins and directions, for every (N, 4, 4) pose, so that Embree alone is timed."""
    rays = []
    for pose in poses:
        ahead = aim_rays(pose[:3, :3].astype(np.float32), renderer.fan.direction)
        start = (pose[:3, 3] - renderer.caster.centre_m).astype(np.float32)
        rays.append((np.tile(start, (len(ahead), 1)), ahead))
    return rays


def time_once(work: Callable[[int], object], pool: ThreadPoolExecutor) -> float:
    """Return the seconds a frame."""
    begin = time.perf_counter()
    list(pool.map(work, range(FRAMES)))
    return (time.perf_counter() - begin) / FRAMES


def time_frames(simulated: SimulatedSequence, threads: int) -> tuple[float, float]:
    """Return the seconds a frame of the simulator, and of Embree alone: medians over the rounds."""
    renderer, truth = simulated.renderer, simulated.sequence.groundtruth
    assert truth is not None
    rays = prepare_rays(renderer, truth.world_from_vehicle)
    bare_s, frame_s = [], []
    with ThreadPoolExecutor(threads) as pool:
        for _ in range(ROUNDS):
            bare_s.append(time_once(lambda i: renderer.caster.shoot(*rays[i], simulated.sonar.range_max), pool))
            frame_s.append(time_once(simulated.sequence.read_frame, pool))
    return statistics.median(frame_s), statistics.median(bare_s)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print frames a second, Embree's rays a second and their ratio, a row for each scene and number of threads."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.benchmark.simulator",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("scene", nargs="?", default="seafloor", help="name of a scene, a mesh file, or all")
    parser.add_argument("--sonar", default="oculus_m750d_high", help="name of a preset")
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2], help="numbers of threads, each timed")
    chosen = parser.parse_args(arguments)
    print(
        f"{'scene':<20} {'faces':>8} {'beams x rays':>12} {'threads':>7} {'frames/s':>8} {'Embree Mrays/s':>14} share"
    )
    for scene in SCENES if chosen.scene == "all" else [chosen.scene]:
        simulated = simulate(scene, chosen.sonar, FRAMES)
        rays, beams = len(simulated.renderer.fan.column), simulated.renderer.model.shape[1]
        size = f"{len(simulated.scene.faces):>8} {f'{beams} x {rays // beams}':>12}"
        for threads in chosen.threads:
            frame_s, bare_s = time_frames(simulated, threads)
            speed = f"{1 / frame_s:>8.1f} {rays / bare_s / 1e6:>14.2f} {bare_s / frame_s:.2f}"
            print(f"{scene:<20} {size} {threads:>7} {speed}", flush=True)


if __name__ == "__main__":
    main()
