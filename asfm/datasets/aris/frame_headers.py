"""Frame headers of ARIS recordings (DDF version 5): layout, reading and validation."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asfm.errors import AsfmError
from asfm.regular_file import check_file, open_file

SIGNATURE = b"DDF\x05"
HEADER_BYTES = 1024
"""Of the file's header and of each frame's."""
FRAME_HEADER = np.dtype(
    {
        "names": [
            "frame_time_us",
            "version",
            "ping_mode",
            "sample_period_us",
            "sound_speed_m_s",
            "samples_per_beam",
            "sample_start_delay_us",
            "large_lens",
            "system_type",
            "reordered_samples",
        ],
        "formats": ["<u8", "S4", "<u4", "<u4", "<f4", "<u4", "<u4", "<u4", "<u4", "<u4"],
        "offsets": [4, 12, 436, 452, 464, 468, 476, 480, 484, 516],
        "itemsize": HEADER_BYTES,
    }
)
BEAMS_BY_PING_MODE = {1: 48, 2: 48, 3: 96, 4: 96, 5: 96, 6: 64, 7: 64, 8: 64, 9: 128, 10: 128, 11: 128, 12: 128}
MAX_SAMPLES = 100_000
"""Per beam; the sonar records at most 4096, so a larger number is a damaged header."""
MIN_SOUND_SPEED_M_S, MAX_SOUND_SPEED_M_S = 1000, 2000


def read_headers(path: Path) -> NDArray[Any]:
    """Read the headers of all frames, and check that complete frames of one size fill the file.

    Returns:
        (N,) records of :data:`FRAME_HEADER`.

    Raises:
        AsfmError: the file is cut off, holds no frame, or a header is damaged or states another size.
    """
    size = check_file(path, "an ARIS recording")
    chunks: list[bytes] = []
    frame_bytes = shape = None
    with open_file(path, "an ARIS recording") as file:
        if file.read(4) != SIGNATURE:
            raise AsfmError(f"{path}: expected an ARIS recording that starts with the bytes DDF 05, found others")
        offset = HEADER_BYTES
        while offset + HEADER_BYTES <= size:
            file.seek(offset)
            chunks.append(file.read(HEADER_BYTES))
            found = _check_header(path, len(chunks) - 1, chunks[-1])
            shape = found if shape is None else shape
            if found != shape:
                raise AsfmError(
                    f"{path}, frame {len(chunks) - 1}: expected {shape[0]} samples x {shape[1]} beams as in frame 0, "
                    f"found {found[0]} x {found[1]}: split the recording where its settings change"
                )
            frame_bytes = HEADER_BYTES + shape[0] * shape[1]
            offset += frame_bytes
    if frame_bytes is None:
        raise AsfmError(f"{path}: expected at least one frame, found {size} bytes in total: the file is cut off")
    complete = (size - HEADER_BYTES) // frame_bytes
    if offset != size:
        raise AsfmError(
            f"{path}: expected {HEADER_BYTES + (complete + 1) * frame_bytes} bytes ({HEADER_BYTES} and "
            f"{complete + 1} frames of {frame_bytes}), found {size}: the file is cut off after {complete} complete "
            f"frames; copy it again, or truncate it to {HEADER_BYTES + complete * frame_bytes} bytes to use those"
        )
    return np.frombuffer(b"".join(chunks), dtype=FRAME_HEADER)


def _check_header(path: Path, index: int, content: bytes) -> tuple[int, int]:
    """Check the header of one frame on its own, and return (samples, beams)."""
    header = np.frombuffer(content, dtype=FRAME_HEADER)[0]
    if header["version"] != SIGNATURE:
        raise AsfmError(f"{path}, frame {index}: expected a frame header with the bytes DDF 05, found others")
    beams, samples = BEAMS_BY_PING_MODE.get(int(header["ping_mode"])), int(header["samples_per_beam"])
    if beams is None:
        raise AsfmError(f"{path}, frame {index}: expected a ping mode of 1..12, found {header['ping_mode']}")
    if not 2 <= samples <= MAX_SAMPLES:
        raise AsfmError(f"{path}, frame {index}: expected 2..{MAX_SAMPLES} samples per beam, found {samples}")
    if not header["reordered_samples"]:
        raise AsfmError(
            f"{path}, frame {index}: expected samples in beam order, found raw order "
            "(ReorderedSamples is 0): save the recording with the maker's software"
        )
    if header["sample_period_us"] == 0 or not (MIN_SOUND_SPEED_M_S < header["sound_speed_m_s"] < MAX_SOUND_SPEED_M_S):
        raise AsfmError(
            f"{path}, frame {index}: expected a sample period above 0 us and a sound speed of "
            f"{MIN_SOUND_SPEED_M_S}..{MAX_SOUND_SPEED_M_S} m/s, "
            f"found {header['sample_period_us']} us and {header['sound_speed_m_s']} m/s"
        )
    return samples, beams


def check_settings(path: Path, headers: NDArray[Any]) -> None:
    """Check that the settings that define the pixel grid are the same in all frames.

    Args:
        path: the file, for messages.
        headers: (N,) records of :data:`FRAME_HEADER`.

    Raises:
        AsfmError: a frame has another sample delay, sample period or lens.
    """
    for name in ("sample_start_delay_us", "sample_period_us", "large_lens"):
        for index in np.flatnonzero(headers[name] != headers[name][0])[:1]:
            raise AsfmError(
                f"{path}, frame {index}: expected {name} {headers[name][0]} as in frame 0, found "
                f"{headers[name][index]}: split the recording where its settings change"
            )
