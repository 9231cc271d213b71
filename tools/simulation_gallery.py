"""Draw a recorded frame and a simulated one beside each other, both as fans.

Run as ``python tools/simulation_gallery.py SEQUENCE OUTPUT.png [--frame N] [--scene SCENE]``. The simulated sonar has
the recorded one's ranges, beams and aperture. Publish a picture only of recordings whose licence allows it.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from asfm.datasets import open_sequence
from asfm.fan import FanGrid
from asfm.simulation.motions import find_motion
from asfm.simulation.scenes import find_scene
from asfm.simulation.sensor import ImagingSonar
from asfm.simulation.simulate import simulate_path
from asfm.sonar import SonarModel
from asfm.types import ImageArray, Trajectory

HEIGHT_PX = 720
GAP_PX = 24


def imitate_sonar(model: SonarModel) -> ImagingSonar:
    """Describe a simulated sonar with the grid of a recorded one."""
    edges_m, bearings_deg = model.range_edges_m, np.rad2deg(model.bearing_rad)
    return ImagingSonar(
        name=f"simulated {model.name}",
        range_min=float(edges_m[0]),
        range_max=float(edges_m[-1]),
        range_bins=model.shape[0],
        azimuth=float(np.rad2deg(model.bearing_edges_rad[-1] - model.bearing_edges_rad[0])),
        azimuth_bins=model.shape[1],
        bearings_deg=tuple(bearings_deg.tolist()),
        elevation=float(np.rad2deg(model.elevation_aperture_rad)),
        elevation_bins=800,
    )


def simulate_frame(model: SonarModel, scene_name: str, seed: int) -> ImageArray:
    """Render one frame of a scene's usual motion with a sonar like the recorded one."""
    sonar = imitate_sonar(model)
    recipe = find_scene(scene_name)
    scene, view = recipe.build(sonar.range_max, np.random.default_rng(seed))
    poses = find_motion(recipe.motion)(view, np.arange(2) / sonar.rate_hz, np.random.default_rng(seed + 1))
    return (
        simulate_path(scene, sonar, Trajectory(np.arange(2) / sonar.rate_hz, poses), seed).sequence.read_frame(0).image
    )


def draw_fan(model: SonarModel, image: ImageArray) -> NDArray[np.uint8]:
    """Draw a polar image as a fan of fixed height, in copper tones on black."""
    fan = FanGrid.fit(model, 4 * HEIGHT_PX, HEIGHT_PX).draw(image)
    grey = np.round(255 * np.clip(fan, 0, 1)).astype(np.uint8)
    return np.asarray(cv2.applyColorMap(grey, cv2.COLORMAP_INFERNO), dtype=np.uint8)


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sequence", type=Path)
    parser.add_argument("output", type=Path)
    parser.add_argument("--frame", type=int, default=0)
    parser.add_argument("--scene", default="seafloor")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args(arguments)
    recorded = open_sequence(chosen.sequence)
    fans = [
        draw_fan(recorded.sonar, recorded.read_frame(chosen.frame).image),
        draw_fan(recorded.sonar, simulate_frame(recorded.sonar, chosen.scene, chosen.seed)),
    ]
    gap = np.zeros((fans[0].shape[0], GAP_PX, 3), dtype=np.uint8)
    cv2.imwrite(str(chosen.output), np.hstack([fans[0], gap, fans[1]]))


if __name__ == "__main__":
    main()
