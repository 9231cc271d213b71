"""Screenshot of the README: the recording of ``asfm demo`` in the Rerun viewer, taken without a screen.

Run as ``python -m tools.pictures.viewer``; takes about a minute. Needs Xvfb and a software Vulkan driver, on Debian and
Ubuntu ``apt install xvfb mesa-vulkan-drivers``, and Pillow, which scikit-image brings along.
"""

import argparse
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from asfm.config import Config
from asfm.pipeline.reconstruction import reconstruct
from asfm.simulation.simulate import simulate
from asfm.visualization.rerun_recorder import RerunRecorder

WINDOW_PX = (1600, 900)
SCREEN_PX = (7000, 4000)
"""Much larger than the window, which may be drawn at twice its size: the pointer is in the middle of the screen, and
over a view it would open a tooltip."""
GREYS, COLOURS = 64, 192
"""Sizes of the palette's parts; speckle does not compress, and more greys make no visible difference."""
TIMEOUT_S = 180.0


def record_scene(scene: str, frame_count: int, seed: int, recording: Path) -> None:
    """Simulate a scene, reconstruct it and record the run."""
    sequence = simulate(scene, frame_count=frame_count, seed=seed).sequence
    recorder = RerunRecorder(recording, sequence)
    reconstruct(sequence, Config(), recorder)
    recorder.close()


def take_screenshot(recording: Path, picture: Path) -> None:
    """Open a recording in the viewer on a virtual screen and save a screenshot.

    Raises:
        SystemExit: xvfb-run is not installed, or the viewer writes no screenshot.
    """
    if shutil.which("xvfb-run") is None:
        raise SystemExit(
            "expected the program xvfb-run, found none: on Debian and Ubuntu, apt install xvfb mesa-vulkan-drivers"
        )
    width, height = WINDOW_PX
    screen = ["xvfb-run", "-a", "-s", f"-screen 0 {SCREEN_PX[0]}x{SCREEN_PX[1]}x24"]
    viewer = [sys.executable, "-m", "rerun", "--new", "--bind", "127.0.0.1", str(recording)]
    command = [*screen, *viewer, "--screenshot-to", str(picture), "--window-size", f"{width}x{height}"]
    with (
        tempfile.TemporaryFile() as log,
        subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT, start_new_session=True) as process,
    ):
        try:
            process.wait(TIMEOUT_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGTERM)
        if not picture.is_file():
            log.seek(0)
            raise SystemExit(
                f"expected a screenshot from the viewer, found none:\n{log.read().decode(errors='replace')}"
            )


def compress_picture(source: Path, target: Path) -> None:
    """Scale a screenshot to the size of its window and reduce it to a palette.

    Greys and colours have palettes of their own: lines and points are few pixels and would lose their colours in one.
    """
    with Image.open(source) as screenshot:
        small = screenshot.convert("RGB").resize(WINDOW_PX, Image.Resampling.LANCZOS)
    pixels = np.asarray(small).reshape(-1, 3)
    colourful = np.unique(pixels[np.ptp(pixels, axis=1) > 40], axis=0)  # each colour once, so that rare ones count too
    chosen = Image.fromarray(colourful[None]).quantize(COLOURS, kmeans=1).getpalette() or []
    greys = np.repeat(np.linspace(0, 255, GREYS).astype(int), 3).tolist()
    palette = Image.new("P", (1, 1))
    palette.putpalette(greys + chosen[: 3 * COLOURS])
    target.parent.mkdir(parents=True, exist_ok=True)
    small.quantize(palette=palette, dither=Image.Dither.NONE).save(target, optimize=True)


def main() -> None:
    """Simulate, reconstruct and take the screenshot."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.pictures.viewer", description=str(__doc__).partition("\n")[0]
    )
    parser.add_argument("--scene", default="seafloor", help="scene to simulate")
    parser.add_argument("--frames", type=int, default=80, help="number of frames")
    parser.add_argument("--seed", type=int, default=0, help="of the simulation")
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "viewer.png", help="PNG to write")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        recording, screenshot = Path(folder) / "run.rrd", Path(folder) / "screenshot.png"
        record_scene(options.scene, options.frames, options.seed, recording)
        take_screenshot(recording, screenshot)
        compress_picture(screenshot, options.output)
    print(f"{options.output}: {options.output.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
