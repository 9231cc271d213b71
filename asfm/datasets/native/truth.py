"""True elevations and noise-free images of simulated frames: truth/NNNNNN.npz in the native folder."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asfm.datasets.images import Bits, quantise, scale_to_unit
from asfm.datasets.npz_file import read_arrays
from asfm.types import FrameTruth, ImageArray


def read_truth_file(path: Path, shape: tuple[int, int], descending: bool) -> FrameTruth:
    """Read the truth of one frame, flipped where needed so that column 0 is starboard.

    Args:
        path: an .npz with elevation_rad (ranges, beams), and clean of the same shape, unsigned integers or 0..1.
        shape: (ranges, beams) of the images.
        descending: whether column 0 on disk is the port-most beam.

    Returns:
        Elevation (ranges, beams) in radians, NaN where there is no echo, and the noise-free image in 0..1.

    Raises:
        AsfmError: the file is missing or damaged, or an array is missing, not numeric or of another shape.
    """
    arrays = read_arrays(path, ("elevation_rad", "clean"), shape, "the truth of a frame")
    elevation_rad, clean = arrays[0].astype(np.float64), _unit_image(arrays[1])
    if descending:
        elevation_rad, clean = np.ascontiguousarray(elevation_rad[:, ::-1]), np.ascontiguousarray(clean[:, ::-1])
    return FrameTruth(elevation_rad, clean)


def write_truth_file(path: Path, truth: FrameTruth, bits: Bits) -> None:
    """Write the truth of one frame: elevation as float32, the clean image as unsigned integers of 8 or 16 bits."""
    np.savez_compressed(
        path,
        elevation_rad=np.asarray(truth.elevation_rad, dtype=np.float32),
        clean=quantise(truth.clean, bits),
    )


def _unit_image(clean: NDArray[Any]) -> ImageArray:
    if np.issubdtype(clean.dtype, np.unsignedinteger):
        return scale_to_unit(clean)
    return np.clip(np.nan_to_num(clean.astype(np.float32)), 0.0, 1.0)
