"""Scale of pickled float images: 0..1, 0..255 of an image that was bytes, or whatever the recording holds."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from asfm.diagnostics import Diagnostic
from asfm.errors import AsfmError

MAX_CUT_SHARE, MAX_CUT_VALUE = 0.02, 3.0
"""Noise lifts fewer pixels above 1 in images of 0..1, and no further; they are cut."""
MAX_NEGATIVE = 1.0
"""Noise never takes an image of 0..1 further below 0."""
MAX_VALUE = 1e30
"""Images are float32."""
INTEGER_SCALES = (255.0, 65535.0)
"""Upper ends of images that were integers of 8 and of 16 bits."""


@dataclass(frozen=True)
class Levels:
    """Finite pixels of one image."""

    lowest: float
    highest: float
    above_one: float
    """Share of the pixels above 1."""
    whole: bool
    """Whether all of them are whole numbers."""


def measure_levels(pixels: Any) -> Levels:
    """Measure the values of an image (ranges, beams) of floats, without those that are not finite."""
    finite = pixels[np.isfinite(pixels)]
    if finite.size == 0:
        return Levels(0.0, 0.0, 0.0, whole=True)
    highest = float(finite.max())
    above_one = float((finite > 1).mean()) if highest > 1 else 0.0
    return Levels(float(finite.min()), highest, above_one, whole=bool((finite == np.rint(finite)).all()))


def choose_scale(where: Path, levels: list[Levels], diagnostics: list[Diagnostic]) -> float:
    """Choose the factor that brings the images of a recording to 0..1.

    Args:
        where: the folder of the pickles, for messages.
        levels: of all images that are floats.
        diagnostics: gets a diagnostic where images are scaled, or pixels above 1 are cut.

    Returns:
        1 where the pixels are in 0..1, apart from a few that noise lifts above; else 1 / 255 or 1 / 65535 where all
        are whole numbers, and one over the highest value otherwise.

    Raises:
        AsfmError: pixels are so far below 0 that they can be no amplitudes.
    """
    lowest = min((item.lowest for item in levels), default=0.0)
    highest = max((item.highest for item in levels), default=0.0)
    if lowest < -MAX_NEGATIVE and lowest < -0.1 * highest:
        raise AsfmError(
            f"{where}: expected echo amplitudes from 0 upwards, found {lowest:.4g} to {highest:.4g}: "
            "decibels? Convert them to 0..1"
        )
    if highest <= 1:
        return 1.0
    if highest > MAX_VALUE:
        raise AsfmError(f"{where}: expected echo amplitudes up to {MAX_VALUE:g}, found {highest:.4g}: damaged pickles?")
    above_one = max(item.above_one for item in levels)
    if above_one <= MAX_CUT_SHARE and highest <= MAX_CUT_VALUE:
        message = (
            f"up to {100 * above_one:.2g} % of an image's pixels lie above 1, up to {highest:.4g}: they are cut to 1"
        )
        diagnostics.append(Diagnostic("clipped-images", message, severity="info"))
        return 1.0
    whole = all(item.whole for item in levels)
    end = next((end for end in INTEGER_SCALES if whole and highest <= end), highest)
    message = f"expected images of 0..1, found values up to {highest:.4g}: all are divided by {end:.6g}"
    diagnostics.append(Diagnostic("scaled-images", message))
    return 1 / end
