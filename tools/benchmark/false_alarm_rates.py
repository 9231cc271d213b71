"""False-alarm rates of CFAR over the design rates, on simulated noise and on recorded empty water."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from asfm.config import CfarConfig
from asfm.frontend.denoising.cfar import detect_cfar
from asfm.types import ImageArray

PROBABILITIES = (1e-1, 1e-2, 1e-3)
WINDOWS = {"2-D": ((4, 4), (16, 12)), "1-D": ((4, 0), (24, 0))}
METHODS = ("ca", "goca", "soca", "os")
EMPTY_WATER = (
    ("DIDSON, empty water", "didson_hull/open_water", slice(None), 4),
    ("Oculus tank a, rows 560 to 690", "oculus_tank_a/frames", slice(560, 690), 6),
    ("Oculus tank b, rows 560 to 690", "oculus_tank_b/frames", slice(560, 690), 6),
)
"""Title, folder of images, rows of water alone, and step between the images used."""


def list_rates(data: Path | None, images: int) -> Iterator[str]:
    """Yield the lines of the table: simulated noise, and recorded water if a data folder is given."""
    yield f"{'measured rate / design rate, at':<46}" + "".join(f"{probability:>9g}" for probability in PROBABILITIES)
    for noise in ("rayleigh", "exponential", "weibull"):
        stack = [_simulate_noise(noise, seed) for seed in range(images)]
        title = "exponential noise" if noise == "exponential" else f"{noise} noise"
        yield from _rate(f"{title}{', shape 4' if noise == 'weibull' else ''}", stack, slice(None), (noise,))
    for title, folder, rows, step in EMPTY_WATER if data is not None else ():
        paths = sorted((data or Path()).joinpath(folder).glob("*.png"))[::step]
        stack = [np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), dtype=np.float32) for path in paths]
        if stack:
            yield from _rate(title, stack, rows, ("rayleigh", "weibull"), ("ca",))


def _rate(
    title: str, stack: list[ImageArray], rows: slice, noises: tuple[str, ...], methods: tuple[str, ...] = METHODS
) -> Iterator[str]:
    yield f"{title}, {len(stack)} images of {stack[0].shape[0]} x {stack[0].shape[1]}"
    for window, (guard_px, reference_px) in WINDOWS.items():
        for noise in noises:
            for method in methods:
                settings = {"guard_px": guard_px, "reference_px": reference_px, "noise": noise, "method": method}
                ratios = [_measure(stack, rows, settings | {"false_alarm_probability": p}) / p for p in PROBABILITIES]
                yield f"  {window}, {noise + ' model':<18} {method:<17}" + "".join(f"{ratio:>9.3f}" for ratio in ratios)


def _measure(stack: list[ImageArray], rows: slice, settings: dict[str, object]) -> float:
    config = CfarConfig.model_validate(settings)
    return float(np.mean([detect_cfar(i, np.ones(i.shape, dtype=bool), config)[rows].mean() for i in stack]))


def _simulate_noise(noise: str, seed: int) -> ImageArray:
    shape = {"exponential": 1.0, "rayleigh": 2.0, "weibull": 4.0}[noise]
    return np.random.default_rng(seed).weibull(shape, (512, 512)).astype(np.float32)
