"""Oculus messages packed field by field after the layout of the public SDK."""

import math
import struct
from typing import Any

import numpy as np

RANGES, BEAMS = 6, 5
BEARINGS = (-3000, -1200, 100, 1500, 3000)
STEP_M = 0.25
TYPES: dict[int, Any] = {0: np.uint8, 1: np.uint16, 3: np.uint32}


def pack_message(body: bytes, number: int = 0x23, version: int = 0) -> bytes:
    return struct.pack("<HHHHHIH", 0x4F53, 1, 0, number, version, len(body), 0) + body


def pack_ping(
    image: np.ndarray | None = None,
    version: int = 1,
    data_size: int = 0,
    gains: np.ndarray | None = None,
    mode: int = 2,
    rate: int = 3,
    flags: int | None = None,
    step_m: float = STEP_M,
    start: float = 0.0,
    bearings: tuple[int, ...] = BEARINGS,
    beams: int | None = None,
    image_shift: int = 0,
    gamma: int = 255,
) -> bytes:
    """Pack one simple ping result, without gaps, as the sonar sends it."""
    image = np.zeros((RANGES, BEAMS)) if image is None else image
    rows = image.astype(np.dtype(TYPES.get(data_size, np.uint8)).newbyteorder("<"))
    lines = [row.tobytes() for row in rows]
    if gains is not None:
        lines = [struct.pack("<I", gain) + line for gain, line in zip(gains, lines, strict=True)]
    pixels = b"".join(lines)
    flags = (0x01 | (0x04 if gains is not None else 0)) if flags is None else flags
    fire = struct.pack("<BBBBBdddd", mode, rate, 255, gamma, flags, 2.0, 50.0, 0.0, 35.0)
    grid = (len(rows), len(bearings) if beams is None else beams)
    offset = (122 if version == 1 else 202) + 2 * len(bearings) + 10
    sizes = (offset + image_shift, len(pixels), offset + len(pixels))
    if version == 1:
        head = struct.pack("<IIdddd", 7, 0, 2.1e6, math.nan, 1e190, 1500.0) + struct.pack("<I", int(start))
        head += struct.pack("<BdHHIII", data_size, step_m, *grid, *sizes)
    else:
        head = struct.pack("<I32x", 0) + struct.pack(
            "<IIdddddddd", 7, 0, 2.1e6, 11.0, 1.1, 90.0, 1.0, 2.0, 1500.0, start
        )
        head += struct.pack("<BdHH16xIII", data_size, step_m, *grid, *sizes)
    table = struct.pack(f"<{len(bearings)}h", *bearings)
    return pack_message(fire + head + table + bytes(10) + pixels, version=0 if version == 1 else 2)
