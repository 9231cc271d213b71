"""Gallery of the README: a recorded ping beside a simulated one, and simulated sonars in other scenes.

Run as ``python -m tools.pictures.gallery RECORDING OUTPUT.png``. The README's picture takes the Oculus ping that
liboculus tests itself with, ``one_ping_8bit.raw``. Publish only recordings whose licence allows it.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from asfm.datasets import open_sequence
from asfm.geometry.fan import FanGrid
from asfm.geometry.poses import make_pose
from asfm.geometry.sonar import SonarModel
from asfm.simulation.scenes.scene import Scene, join_scenes
from asfm.simulation.scenes.seafloor import strew_rocks
from asfm.simulation.scenes.shapes import make_ground, texture
from asfm.simulation.simulate import simulate, simulate_path
from asfm.simulation.sonars.parameters import ImagingSonar
from asfm.simulation.sonars.presets import find_preset
from asfm.types import ImageArray, Trajectory

Picture = NDArray[np.uint8]

WIDTH_PX = 1280
UPPER_PX, LOWER_PX = 560, 276
MARGIN_PX, LABEL_PX = 16, 60
UPPER_GAMMA, LOWER_GAMMA = 0.5, 0.75
"""Exponents of the displayed amplitudes: the recorded ping's own encoding; slightly brighter than linear."""
SHADES = 48
"""Grey levels. 256 would double the file without a visible difference."""
FONT = cv2.FONT_HERSHEY_SIMPLEX
BACKGROUND, INK, FAINT_INK = (20, 14, 11), (236, 230, 224), (170, 160, 150)
"""Colours in the order blue, green, red."""
HEIGHT_M, DEPRESSION_DEG = 0.6, 38.4
"""Pose of a sonar with 12 degrees of aperture that receives the bottom from 0.85 to 1.11 m at half amplitude, as in the
recorded ping."""
SHOWN = (
    ("hull", "didson", "hull", 37),
    ("pier", "oculus_m750d_high", "pier", 2),
    ("wreck", "blueview_p900", "wreck", 20),
    ("seafloor", "aris_3000", "boulders", 2),
)
"""Scene, sonar, name of the scene in the label, frame."""


def imitate_sonar(model: SonarModel) -> ImagingSonar:
    """Return the simulated Oculus with a recorded one's grid, noise fitted to the README's ping, and full speckle."""
    preset, edges_m = find_preset("oculus_m1200d_high"), model.range_edges_m
    grid = {
        "name": f"simulated {model.name}",
        "range_min": float(edges_m[0]),
        "range_max": float(edges_m[-1]),
        "range_bins": model.shape[0],
        "azimuth_bins": model.shape[1],
        "bearings_deg": tuple(np.rad2deg(model.bearing_rad).tolist()),
    }
    # The aperture ends where the beam has fallen by 6 dB; a bottom so near echoes some degrees beyond.
    beam = {"elevation": 28.0, "elevation_edge_db": -6.0 * (28 / 12) ** 2, "elevation_bins": 1000}
    noise = {"add_sigma": 0.038, "noise_range_exponent": 1.65, "mult_sigma": 0.523}
    return ImagingSonar.model_validate(preset.model_dump() | grid | beam | noise)


def make_bottom(rng: np.random.Generator) -> Scene:
    """Make a sea floor with low rises and a few stones."""
    ground = make_ground((5.0, 5.0), rng, swell_m=0.02, step_m=0.035)
    return join_scenes("bottom", [texture("ground", ground, 0.3, rng), *strew_rocks(ground[0], 1.5, 0.02, rng)])


def simulate_bottom(model: SonarModel, seed: int) -> ImageArray:
    """Simulate one ping of the sea floor with a sonar like the recorded one."""
    from scipy.spatial.transform import Rotation

    scene = make_bottom(np.random.default_rng(seed))
    at_m = np.array([[-0.75, 0.0, HEIGHT_M]])
    pose = make_pose(at_m, Rotation.from_euler("Y", [[np.deg2rad(DEPRESSION_DEG)]]))
    path = Trajectory(np.zeros(1), pose)
    return simulate_path(scene, imitate_sonar(model), path, seed).sequence.read_frame(0).image


def draw_panel(model: SonarModel, image: ImageArray, size: tuple[int, float], title: str, subtitle: str) -> Picture:
    """Draw a polar image as a fan in a panel, with two lines of text below.

    Args:
        model: sonar of the image.
        image: (ranges, beams) in 0..1.
        size: height of the panel in pixels, and the exponent of the displayed amplitudes.
        title: first line.
        subtitle: second line.
    """
    height_px, gamma = size
    fan = FanGrid.fit(model, 4 * height_px, height_px)
    shade = np.round(fan.draw(np.clip(image, 0, 1)) ** gamma * (SHADES - 1))
    grey = np.round(255 / (SHADES - 1) * shade).astype(np.uint8)
    lines = ((title, 0.6, INK), (subtitle, 0.45, FAINT_INK))
    widths_px = [cv2.getTextSize(text, FONT, scale, 1)[0][0] for text, scale, _ in lines]
    width_px = max(fan.width_px, *widths_px)
    panel = np.full((height_px + LABEL_PX, width_px, 3), BACKGROUND, dtype=np.uint8)
    left_px = (width_px - fan.width_px) // 2
    view = panel[:, left_px : left_px + fan.width_px][height_px - fan.height_px : height_px]
    view[fan.inside] = cv2.applyColorMap(grey, cv2.COLORMAP_INFERNO)[fan.inside]
    for row_px, (text, scale, ink), text_px in zip((26, 48), lines, widths_px, strict=True):
        at_px = ((width_px - text_px) // 2, height_px + row_px)
        cv2.putText(panel, text, at_px, FONT, scale, ink, 1, cv2.LINE_AA)
    return panel


def join_row(panels: list[Picture]) -> Picture:
    """Join panels of one height to a row of the picture's width."""
    spare_px = WIDTH_PX - sum(panel.shape[1] for panel in panels)
    row = np.full((panels[0].shape[0] + MARGIN_PX, WIDTH_PX, 3), BACKGROUND, dtype=np.uint8)
    left_px = spare_px // (len(panels) + 1)
    for panel in panels:
        row[MARGIN_PX:, left_px : left_px + panel.shape[1]] = panel
        left_px += panel.shape[1] + spare_px // (len(panels) + 1)
    return row


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw the gallery and write it."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.pictures.gallery",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("recording", type=Path, help="sequence with the recorded ping")
    parser.add_argument("output", type=Path, help="PNG to write")
    parser.add_argument("--frame", type=int, default=0, help="frame of the recording")
    parser.add_argument("--seed", type=int, default=11, help="seed of the simulated sea floor")
    chosen = parser.parse_args(arguments)
    sequence = open_sequence(chosen.recording)
    recorded_image, model, size = sequence.read_frame(chosen.frame).amplitude, sequence.sonar, (UPPER_PX, UPPER_GAMMA)
    simulated_image = simulate_bottom(model, chosen.seed)
    upper = [
        draw_panel(model, recorded_image, size, "recorded", model.name),
        draw_panel(model, simulated_image, size, "simulated", "a sea floor, on the same grid of ranges and beams"),
    ]
    lower = []
    for scene, preset, title, index in SHOWN:
        sequence = simulate(scene, preset, 40, seed=3).sequence
        model, image = sequence.sonar, sequence.read_frame(index).image
        lower.append(draw_panel(model, image, (LOWER_PX, LOWER_GAMMA), f"simulated {title}", model.name))
    cv2.imwrite(str(chosen.output), np.vstack([join_row(upper), join_row(lower)]), [cv2.IMWRITE_PNG_COMPRESSION, 9])


if __name__ == "__main__":
    main()
