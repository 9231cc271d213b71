"""True elevations and noise-free images of simulated frames: truth/NNNNNN.npz in the native folder."""

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asfm.datasets.images import Bits, quantise, scale_to_unit
from asfm.errors import AsfmError
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
    try:
        with np.load(path, allow_pickle=False) as arrays:
            elevation_rad = _read_array(path, arrays, "elevation_rad", shape).astype(np.float64)
            clean = _unit_image(_read_array(path, arrays, "clean", shape))
    except FileNotFoundError:
        raise AsfmError(f"{path}: expected the truth of a frame, found none") from None
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise AsfmError(f"{path}: expected an .npz with elevation_rad and clean, found: {error}") from None
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


def _read_array(path: Path, arrays: Any, name: str, shape: tuple[int, int]) -> NDArray[Any]:
    if name not in arrays:
        raise AsfmError(f"{path}: expected an array {name}, found {', '.join(arrays) or 'none'}")
    array = np.asarray(arrays[name])
    if array.shape != shape:
        raise AsfmError(f"{path}: expected {name} of shape {shape} (ranges, beams), found {array.shape}")
    if not (np.issubdtype(array.dtype, np.floating) or np.issubdtype(array.dtype, np.unsignedinteger)):
        raise AsfmError(f"{path}: expected {name} to hold numbers, found {array.dtype}")
    return array


def _unit_image(clean: NDArray[Any]) -> ImageArray:
    if np.issubdtype(clean.dtype, np.unsignedinteger):
        return scale_to_unit(clean)
    return np.clip(np.nan_to_num(clean.astype(np.float32)), 0.0, 1.0)
