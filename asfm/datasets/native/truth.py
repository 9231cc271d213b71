"""truth/NNNNNN.npz of the native folder: what a simulation knows of each frame."""

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asfm.datasets.images import Bits, quantise, scale_to_unit
from asfm.errors import AsfmError
from asfm.types import FrameTruth, ImageArray


def read_truth_file(path: Path, shape: tuple[int, int], descending: bool) -> FrameTruth:
    """Read one file of truth and turn column 0 to starboard.

    Args:
        path: an .npz with elevation_rad (ranges, beams) and clean, unsigned integers or 0..1, of the same shape.
        shape: (ranges, beams) of the images.
        descending: column 0 on disk is the most port beam.

    Raises:
        AsfmError: the file is missing or damaged, or an array is missing or of another shape.
    """
    try:
        with np.load(path, allow_pickle=False) as arrays:
            elevation_rad = _pick(path, arrays, "elevation_rad", shape).astype(np.float64)
            clean = _unit_image(_pick(path, arrays, "clean", shape))
    except FileNotFoundError:
        raise AsfmError(f"{path}: expected the truth of a frame, found no file") from None
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise AsfmError(f"{path}: expected an .npz with elevation_rad and clean, found: {error}") from None
    if descending:
        elevation_rad, clean = np.ascontiguousarray(elevation_rad[:, ::-1]), np.ascontiguousarray(clean[:, ::-1])
    return FrameTruth(elevation_rad, clean)


def write_truth_file(path: Path, truth: FrameTruth, bits: Bits) -> None:
    """Write one file of truth; elevation as float32, the clean image with the frames' own number of bits."""
    np.savez_compressed(
        path,
        elevation_rad=np.asarray(truth.elevation_rad, dtype=np.float32),
        clean=quantise(truth.clean, bits),
    )


def _pick(path: Path, arrays: Any, name: str, shape: tuple[int, int]) -> NDArray[Any]:
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
