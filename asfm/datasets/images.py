"""Grey PNG images: header, decoding with integrity checks, scaling to 0..1, and encoding."""

import struct
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from asfm.datasets.png_chunks import SIGNATURE, extract_grey_png
from asfm.errors import AsfmError
from asfm.file_kinds import SNIFFED_BYTES, name_kind
from asfm.regular_file import open_file, read_file
from asfm.types import ImageArray

Bits = Literal[8, 16]

HEADER_BYTES = 33
"""Signature and the whole IHDR chunk."""
MAX_BYTES = 256 << 20
MAX_PIXELS = 50_000_000
"""The largest images of imaging sonars have two million."""
MAX_COMPRESSION = 1040
"""Deflate makes data smaller by 1032 at most, so that a small file with more pixels is no whole image."""
EXPECTED = "a grey PNG image"
COLOUR_TYPES = {0: "grey", 2: "RGB", 3: "palette", 4: "grey with alpha", 6: "RGB with alpha"}


def read_png_shape(path: Path) -> tuple[int, int]:
    """Read (rows, columns) from the header of a PNG without decoding it.

    Raises:
        AsfmError: the file is missing, not a PNG or not grey.
    """
    with open_file(path, EXPECTED, MAX_BYTES) as file:
        header = file.read(SNIFFED_BYTES)
    return _parse_header(path, header, path.stat().st_size)


def check_png_shape(path: Path, shape: tuple[int, int]) -> None:
    """Check by its header that a PNG is grey and has (rows, columns).

    Raises:
        AsfmError: the file is missing, not a PNG, not grey or of another size.
    """
    _check_shape(path, read_png_shape(path), shape)


def read_grey_png(path: Path, shape: tuple[int, int]) -> NDArray[Any]:
    """Read an 8- or 16-bit grey PNG.

    Args:
        path: the file.
        shape: (rows, columns) that the image must have.

    Returns:
        (rows, columns) uint8 or uint16.

    Raises:
        AsfmError: the file is missing, damaged, not grey or of another size.
    """
    import cv2

    content = read_file(path, EXPECTED, MAX_BYTES)
    _check_shape(path, _parse_header(path, content, len(content)), shape)
    content = extract_grey_png(path, content)
    try:
        pixels = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:  # more pixels than OpenCV accepts
        pixels = None
    if pixels is None or pixels.shape != shape:
        raise AsfmError(f"{path}: expected a grey PNG image, found one that cannot be decoded: write it again")
    return np.asarray(pixels)


def scale_to_unit(pixels: NDArray[Any]) -> ImageArray:
    """Scale unsigned integers to float32 in 0..1, dividing by the largest value of their type; the shape is kept."""
    return np.asarray(pixels / np.float32(np.iinfo(pixels.dtype).max), dtype=np.float32)


def encode_png(pixels: NDArray[Any]) -> bytes:
    """Encode (rows, columns) uint8 or uint16 as a grey PNG."""
    import cv2

    encoded, content = cv2.imencode(".png", pixels)
    assert encoded, "OpenCV encodes every uint8 and uint16 array"
    return bytes(content)


def quantise(image: ImageArray, bits: Bits) -> NDArray[Any]:
    """Round an image in 0..1 to unsigned integers of the same shape; the inverse of :func:`scale_to_unit`."""
    dtype = np.uint8 if bits == 8 else np.uint16
    return np.round(image.astype(np.float64) * np.iinfo(dtype).max).astype(dtype)


def _parse_header(path: Path, content: bytes, file_bytes: int) -> tuple[int, int]:
    """Return (rows, columns) after checks of the kind, and of the size against that of the file."""
    if len(content) < HEADER_BYTES or not content.startswith(SIGNATURE) or content[12:16] != b"IHDR":
        kind = None if content.startswith(SIGNATURE) else name_kind(content[:SNIFFED_BYTES])
        found = kind or f"{min(file_bytes, HEADER_BYTES)} bytes that are no PNG header"
        raise AsfmError(f"{path}: expected a grey PNG image, found {found}")
    columns, rows, bits, colour = struct.unpack_from(">IIBB", content, 16)
    if colour != 0:
        raise AsfmError(
            f"{path}: expected a grey PNG image (one channel), "
            f"found {COLOUR_TYPES.get(colour, f'colour type {colour}')}: convert it to grey"
        )
    if rows * columns > MAX_PIXELS or rows * columns * bits > 8 * MAX_COMPRESSION * file_bytes:
        raise AsfmError(
            f"{path}: expected a whole {EXPECTED[2:]} of {MAX_PIXELS} pixels at most, found a header of {rows} x "
            f"{columns} pixels in a file of {file_bytes} bytes: write it again"
        )
    return rows, columns


def _check_shape(path: Path, found: tuple[int, int], shape: tuple[int, int]) -> None:
    if found != shape:
        raise AsfmError(
            f"{path}: expected {shape[0]} x {shape[1]} pixels (ranges x beams) as in the first image, "
            f"found {found[0]} x {found[1]}"
        )
