"""PNG chunks: checksums and compressed data checked, and reduced to those that a decoder needs.

libpng prints to stderr what it finds wrong, and decoders fill a truncated image with black without a word: all of that
is found before (PNG specification, 3rd edition, sections 5, 7, 9 and 10).
"""

import math
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

from asfm.errors import AsfmError

SIGNATURE = b"\x89PNG\r\n\x1a\n"
GREY_BITS = (1, 2, 4, 8, 16)
MAX_FILTER = 4
"""Number of the last type of filter of a row."""


def extract_grey_png(path: Path, content: bytes) -> bytes:
    """Return a PNG with the header and the pixels of a whole grey PNG alone, without text, profiles and animation.

    Args:
        path: the file, for messages.
        content: its bytes, which begin with a whole IHDR chunk.

    Raises:
        AsfmError: a chunk is damaged or missing, pixels are transparent, or the compressed pixels are damaged, too
            few or too many.
    """
    header, pixels = b"", []
    for name, body in _iterate_chunks(path, content):
        if name == b"IHDR":
            if header:
                raise AsfmError(f"{path}: expected one IHDR chunk in a PNG image, found two: write it again")
            header = body
        elif name == b"tRNS":
            raise AsfmError(f"{path}: expected a grey PNG image, found one with transparent pixels: convert it to grey")
        elif name == b"IDAT":
            pixels.append(body)
    compressed = b"".join(pixels)
    _check_pixels(path, header, compressed)
    parts = ((b"IHDR", header), (b"IDAT", compressed), (b"IEND", b""))
    return SIGNATURE + b"".join(_pack_chunk(name, body) for name, body in parts)


def _iterate_chunks(path: Path, content: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield the name and the body of each chunk before IEND, whose checksums are right."""
    position = len(SIGNATURE)
    while position + 12 <= len(content):
        length, name = struct.unpack_from(">I4s", content, position)
        end = position + 12 + length
        if end > len(content):
            break
        if zlib.crc32(content[position + 4 : end - 4]) != struct.unpack_from(">I", content, end - 4)[0]:
            raise AsfmError(f"{path}: expected an intact PNG image, found a wrong checksum at byte {position}")
        if name == b"IEND":
            return
        yield name, content[position + 8 : end - 4]
        position = end
    raise AsfmError(f"{path}: expected a complete PNG image, found one cut off after {len(content)} bytes")


def _check_pixels(path: Path, header: bytes, compressed: bytes) -> None:
    """Check that the compressed pixels are intact and as many as the header says."""
    if len(header) != 13:
        raise AsfmError(f"{path}: expected one IHDR chunk of 13 bytes in a PNG image, found {len(header)} bytes")
    columns, rows, bits, _, compression, filtering, interlace = struct.unpack(">IIBBBBB", header)
    if bits not in GREY_BITS or compression or filtering or interlace > 1:
        found = f"{bits} bits, methods {compression}, {filtering} and {interlace}"
        raise AsfmError(f"{path}: expected a grey PNG image of 8 or 16 bits, found {found}: write it again")
    sizes = _row_sizes(columns, rows, bits, bool(interlace))
    expected = sum(count * size for count, size in sizes)
    decompressor = zlib.decompressobj()
    try:
        pixels = decompressor.decompress(compressed, expected + 1)
    except zlib.error as error:
        raise AsfmError(
            f"{path}: expected an intact PNG image, found damaged pixels ({error}): write it again"
        ) from None
    if len(pixels) != expected or not decompressor.eof or decompressor.unused_data:
        found = f"{len(pixels)}{'' if decompressor.eof else ' or more'}"
        raise AsfmError(f"{path}: expected {expected} bytes of pixels in the PNG image, found {found}: write it again")
    position = 0
    for count, size in sizes:
        if size and max(pixels[position : position + count * size : size], default=0) > MAX_FILTER:
            raise AsfmError(f"{path}: expected an intact PNG image, found a row with an unknown filter: write it again")
        position += count * size


def _row_sizes(columns: int, rows: int, bits: int, interlaced: bool) -> list[tuple[int, int]]:
    """Return the number of rows and the bytes of a row, its filter included, of each pass (Adam7, or a single one)."""
    passes = [(0, 0, 1, 1)]
    if interlaced:  # first row, first column, step of rows, step of columns
        passes = [(0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2), (0, 1, 2, 2), (1, 0, 2, 1)]
    sizes = []
    for row, column, row_step, column_step in passes:
        height, width = math.ceil((rows - row) / row_step), math.ceil((columns - column) / column_step)
        if height > 0 and width > 0:
            sizes.append((height, 1 + math.ceil(width * bits / 8)))
    return sizes


def _pack_chunk(name: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
