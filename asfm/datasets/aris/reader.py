"""Reader of ARIS recordings (.aris, DDF version 5).

The layout is that of Sound Metrics' public SDK: a file header, then for each frame a header and one byte a sample,
sample-major, 0..255 for 0..80 dB. Little-endian, headers of 1024 bytes.
"""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asfm.datasets.aris.lenses import beam_centres_rad
from asfm.datasets.images import scale_to_unit
from asfm.diagnostics import Diagnostic
from asfm.errors import AsfmError
from asfm.geometry.sonar import SonarModel
from asfm.sequence import Sequence
from asfm.types import FloatArray, Frame

DECIBEL_SPAN = 80.0
"""Samples 0..255 are 0..80 dB."""
SIGNATURE = b"DDF\x05"
HEADER_BYTES = 1024
HEADER = np.dtype(
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
BEAMS_OF_PING_MODE = {1: 48, 2: 48, 3: 96, 4: 96, 5: 96, 6: 64, 7: 64, 8: 64, 9: 128, 10: 128, 11: 128, 12: 128}
SYSTEM_NAMES = {0: "ARIS 1800", 1: "ARIS 3000", 2: "ARIS 1200"}
ELEVATION_APERTURE_DEG = 14.0
MAX_SAMPLES = 100_000
"""Far beyond what the sonar records (4096): a larger number is a damaged header."""


@dataclass(frozen=True)
class ArisFrames:
    """Where the frames of one recording lie."""

    path: Path
    timestamps_s: FloatArray
    shape: tuple[int, int]
    """(samples, beams)"""


def is_aris(path: Path) -> bool:
    """Tell by its first bytes whether a file is an ARIS recording."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(4) == SIGNATURE


def read_aris(path: Path, elevation_aperture_deg: float = ELEVATION_APERTURE_DEG) -> Sequence:
    """Open an ARIS recording.

    Ranges come from the sample delay, the sample period and the speed of sound; the window fields of the header are
    about 1 % off. Beam 0 is the right-most: already column 0 to starboard. Stamps are the recording computer's clock,
    absolute seconds since 1970. Compass and depth have no stated accuracy and are left out.

    Args:
        path: the file.
        elevation_aperture_deg: not in the file; 14 degrees is what papers state for the standard lenses.

    Raises:
        AsfmError: the file is cut off or damaged, its samples are in raw order, or the sonar's settings change.
    """
    headers = _read_headers(path)
    first = headers[0]
    beams, samples = BEAMS_OF_PING_MODE[int(first["ping_mode"])], int(first["samples_per_beam"])
    _check_settings(path, headers)
    timestamps_s = headers["frame_time_us"] * 1e-6
    for index in np.flatnonzero(np.diff(headers["frame_time_us"].astype(np.int64)) <= 0)[:1]:
        raise AsfmError(
            f"{path}, frame {index + 1}: expected a time after {timestamps_s[index]:.6f} s (frame {index}), "
            f"found {timestamps_s[index + 1]:.6f} s: stamps must rise and never repeat"
        )
    telephoto = bool(first["large_lens"]) and beams in (48, 96)
    metres_per_us = float(first["sound_speed_m_s"]) * 1e-6 / 2
    near_m = int(first["sample_start_delay_us"]) * metres_per_us
    step_m = int(first["sample_period_us"]) * metres_per_us
    name = SYSTEM_NAMES.get(int(first["system_type"]), "ARIS") + (", telephoto lens" if telephoto else "")
    sonar = SonarModel(
        name=f"{name}, {beams} beams",
        range_m=near_m + step_m * (np.arange(samples, dtype=np.float64) + 0.5),
        bearing_rad=beam_centres_rad(beams, telephoto),
        elevation_aperture_rad=float(np.radians(elevation_aperture_deg)),
    )
    return Sequence(
        name=path.stem,
        sonar=sonar,
        timestamps_s=timestamps_s,
        read_frame=partial(read_aris_frame, ArisFrames(path, timestamps_s, (samples, beams))),
        kind="aris",
        diagnostics=_diagnose(headers, telephoto, elevation_aperture_deg),
    )


def read_aris_frame(frames: ArisFrames, index: int) -> Frame:
    """Read one frame's samples; 0..80 dB become 0..1."""
    if not 0 <= index < len(frames.timestamps_s):
        raise IndexError(f"frame {index} of a sequence with frames 0..{len(frames.timestamps_s) - 1}")
    size = frames.shape[0] * frames.shape[1]
    with frames.path.open("rb") as file:
        file.seek(2 * HEADER_BYTES + index * (HEADER_BYTES + size))
        content = file.read(size)
    if len(content) < size:
        raise AsfmError(f"{frames.path}, frame {index}: expected {size} bytes of samples, found {len(content)}")
    image = scale_to_unit(np.frombuffer(content, dtype=np.uint8).reshape(frames.shape))
    invalid = np.zeros(frames.shape, dtype=bool)
    return Frame(index, float(frames.timestamps_s[index]), image, invalid, decibel_span=DECIBEL_SPAN)


def _read_headers(path: Path) -> NDArray[Any]:
    """Read every frame's header and check that whole frames of one size fill the file. Returns (frames,) of HEADER."""
    size = path.stat().st_size
    chunks: list[bytes] = []
    frame_bytes = shape = None
    with path.open("rb") as file:
        if file.read(4) != SIGNATURE:
            raise AsfmError(f"{path}: expected an ARIS recording that starts with DDF and 5, found other bytes")
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
        raise AsfmError(f"{path}: expected at least one frame, found {size} bytes in all: the file is cut off")
    whole = (size - HEADER_BYTES) // frame_bytes
    if offset != size:
        raise AsfmError(
            f"{path}: expected {HEADER_BYTES + (whole + 1) * frame_bytes} bytes ({HEADER_BYTES} and {whole + 1} frames "
            f"of {frame_bytes}), found {size}: the file is cut off after {whole} whole frames; copy it again, "
            f"or cut it to {HEADER_BYTES + whole * frame_bytes} bytes to use those"
        )
    return np.frombuffer(b"".join(chunks), dtype=HEADER)


def _check_header(path: Path, index: int, content: bytes) -> tuple[int, int]:
    """Check what one header says by itself. Returns (samples, beams)."""
    header = np.frombuffer(content, dtype=HEADER)[0]
    if header["version"] != SIGNATURE:
        raise AsfmError(f"{path}, frame {index}: expected a frame header that says DDF and 5, found other bytes")
    beams, samples = BEAMS_OF_PING_MODE.get(int(header["ping_mode"])), int(header["samples_per_beam"])
    if beams is None:
        raise AsfmError(f"{path}, frame {index}: expected a ping mode of 1..12, found {header['ping_mode']}")
    if not 2 <= samples <= MAX_SAMPLES:
        raise AsfmError(f"{path}, frame {index}: expected 2..{MAX_SAMPLES} samples a beam, found {samples}")
    if not header["reordered_samples"]:
        raise AsfmError(
            f"{path}, frame {index}: expected samples in beam order, found them as the sonar sends them "
            "(ReorderedSamples is 0): save the recording with the maker's software"
        )
    if header["sample_period_us"] == 0 or not 1000 < header["sound_speed_m_s"] < 2000:
        raise AsfmError(
            f"{path}, frame {index}: expected a sample period above 0 us and a speed of sound of 1000..2000 m/s, "
            f"found {header['sample_period_us']} us and {header['sound_speed_m_s']} m/s"
        )
    return samples, beams


def _check_settings(path: Path, headers: NDArray[Any]) -> None:
    for name in ("sample_start_delay_us", "sample_period_us", "large_lens"):
        for index in np.flatnonzero(headers[name] != headers[name][0])[:1]:
            raise AsfmError(
                f"{path}, frame {index}: expected {name} {headers[name][0]} as in frame 0, found "
                f"{headers[name][index]}: split the recording where its settings change"
            )


def _diagnose(headers: NDArray[Any], telephoto: bool, elevation_aperture_deg: float) -> tuple[Diagnostic, ...]:
    found = []
    speeds = headers["sound_speed_m_s"]
    if np.ptp(speeds) > 0:
        message = (
            f"the sound speed varies from {speeds.min():.2f} to {speeds.max():.2f} m/s; "
            f"all ranges use that of frame 0, {speeds[0]:.2f} m/s"
        )
        found.append(Diagnostic("variable-sound-speed", message))
    if telephoto:
        message = (
            "the elevation aperture of the telephoto lens is not in the file: "
            f"{elevation_aperture_deg:g} degrees are assumed"
        )
        found.append(Diagnostic("assumed-aperture", message))
    return tuple(found)
