"""ARIS recordings packed field by field after the layout of the public SDK."""

import struct
from pathlib import Path

SAMPLES = 20
PERIOD_US, DELAY_US, SPEED_M_S = 14, 4593, 1440.0


def pack_header(
    time_us: int,
    ping_mode: int = 9,
    samples: int = SAMPLES,
    delay_us: int = DELAY_US,
    speed_m_s: float = SPEED_M_S,
    large_lens: int = 0,
    reordered: int = 1,
    version: bytes = b"DDF\x05",
    period_us: int = PERIOD_US,
) -> bytes:
    header = bytearray(1024)
    for form, offset, value in [
        ("<Q", 4, time_us),
        ("<4s", 12, version),
        ("<f", 52, 99.0),  # WindowStart: to be ignored
        ("<f", 56, 99.0),
        ("<I", 436, ping_mode),
        ("<I", 452, period_us),
        ("<f", 464, speed_m_s),
        ("<I", 468, samples),
        ("<I", 476, delay_us),
        ("<I", 480, large_lens),
        ("<I", 484, 1),
        ("<I", 516, reordered),
    ]:
        struct.pack_into(form, header, offset, value)
    return bytes(header)


def write_file(path: Path, frames: list[bytes]) -> Path:
    file_header = bytearray(1024)
    file_header[:4] = b"DDF\x05"
    struct.pack_into("<I", file_header, 4, 77)  # FrameCount: to be ignored
    path.write_bytes(bytes(file_header) + b"".join(frames))
    return path
