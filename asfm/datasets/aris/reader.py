"""Reader of ARIS recordings (.aris, DDF version 5).

The layout is that of Sound Metrics' public SDK: a file header, then for each frame a header and one byte per sample,
sample-major, 0..255 for 0..80 dB. Little-endian, headers of 1024 bytes.
"""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asfm.datasets.aris.frame_headers import BEAMS_BY_PING_MODE, HEADER_BYTES, SIGNATURE, check_settings, read_headers
from asfm.datasets.aris.lenses import beam_centres_rad
from asfm.datasets.images import scale_to_unit
from asfm.diagnostics import Diagnostic
from asfm.errors import AsfmError
from asfm.geometry.sonar import SonarModel
from asfm.regular_file import is_regular, open_file
from asfm.sequence import Sequence
from asfm.types import FloatArray, Frame

DECIBEL_SPAN = 80.0
"""Samples 0..255 are 0..80 dB."""
TELEPHOTO_BEAMS = (48, 96)
"""Beam counts of the systems that take a telephoto lens."""
SYSTEM_NAMES = {0: "ARIS 1800", 1: "ARIS 3000", 2: "ARIS 1200"}
ELEVATION_APERTURE_DEG = 14.0
"""Published for the standard lenses; the file does not state it."""


@dataclass(frozen=True)
class ArisFrames:
    """Location of the frames of one recording."""

    path: Path
    timestamps_s: FloatArray
    shape: tuple[int, int]
    """(samples, beams)"""


def is_aris(path: Path) -> bool:
    """Return whether a path is an ARIS recording, by the first bytes of the file."""
    if not is_regular(path):
        return False
    with open_file(path, "an ARIS recording") as file:
        return file.read(4) == SIGNATURE


def read_aris(path: Path, elevation_aperture_deg: float = ELEVATION_APERTURE_DEG) -> Sequence:
    """Open an ARIS recording.

    Compass and depth have no stated accuracy and are left out.

    Args:
        path: the file.
        elevation_aperture_deg: not stated in the file.

    Returns:
        The sequence. Its stamps are the recording computer's clock, seconds since 1970; its images are logarithmic.

    Raises:
        AsfmError: the file is cut off or damaged, its samples are in raw order, the sonar's settings change, or the
            stamps do not increase.
    """
    headers = read_headers(path)
    check_settings(path, headers)
    timestamps_s = _read_timestamps(path, headers)
    sonar = _make_sonar(headers[0], elevation_aperture_deg)
    return Sequence(
        name=path.stem,
        sonar=sonar,
        timestamps_s=timestamps_s,
        read_frame=partial(read_aris_frame, ArisFrames(path, timestamps_s, sonar.shape)),
        kind="aris",
        diagnostics=_diagnose(headers, elevation_aperture_deg),
    )


def read_aris_frame(frames: ArisFrames, index: int) -> Frame:
    """Read one frame; 0..80 dB become 0..1.

    Raises:
        AsfmError: the file was cut off after it was opened.
        IndexError: there is no such frame.
    """
    if not 0 <= index < len(frames.timestamps_s):
        raise IndexError(f"frame {index} of a sequence with frames 0..{len(frames.timestamps_s) - 1}")
    size = frames.shape[0] * frames.shape[1]
    with open_file(frames.path, "an ARIS recording") as file:
        file.seek(2 * HEADER_BYTES + index * (HEADER_BYTES + size))
        content = file.read(size)
    if len(content) < size:
        raise AsfmError(f"{frames.path}, frame {index}: expected {size} bytes of samples, found {len(content)}")
    image = scale_to_unit(np.frombuffer(content, dtype=np.uint8).reshape(frames.shape))
    invalid = np.zeros(frames.shape, dtype=bool)
    return Frame(index, float(frames.timestamps_s[index]), image, invalid, decibel_span=DECIBEL_SPAN)


def _read_timestamps(path: Path, headers: NDArray[Any]) -> FloatArray:
    """Return the stamps (N,) in seconds, which must increase strictly."""
    timestamps_s: FloatArray = headers["frame_time_us"] * 1e-6
    for index in np.flatnonzero(np.diff(headers["frame_time_us"].astype(np.int64)) <= 0)[:1]:
        raise AsfmError(
            f"{path}, frame {index + 1}: expected a time after {timestamps_s[index]:.6f} s (frame {index}), "
            f"found {timestamps_s[index + 1]:.6f} s: stamps must rise and never repeat"
        )
    return timestamps_s


def _make_sonar(header: Any, elevation_aperture_deg: float) -> SonarModel:
    """Return the sonar model that the header of a frame describes.

    Ranges come from the sample delay, the sample period and the sound speed: the window fields of the header are about
    1 % off. Beam 0 is the right-most, so column 0 is starboard already.
    """
    beams, samples = BEAMS_BY_PING_MODE[int(header["ping_mode"])], int(header["samples_per_beam"])
    telephoto = _has_telephoto_lens(header)
    metres_per_us = float(header["sound_speed_m_s"]) * 1e-6 / 2
    near_m = int(header["sample_start_delay_us"]) * metres_per_us
    step_m = int(header["sample_period_us"]) * metres_per_us
    name = SYSTEM_NAMES.get(int(header["system_type"]), "ARIS") + (", telephoto lens" if telephoto else "")
    return SonarModel(
        name=f"{name}, {beams} beams",
        range_m=near_m + step_m * (np.arange(samples, dtype=np.float64) + 0.5),
        bearing_rad=beam_centres_rad(beams, telephoto),
        elevation_aperture_rad=float(np.radians(elevation_aperture_deg)),
    )


def _has_telephoto_lens(header: Any) -> bool:
    return bool(header["large_lens"]) and BEAMS_BY_PING_MODE[int(header["ping_mode"])] in TELEPHOTO_BEAMS


def _diagnose(headers: NDArray[Any], elevation_aperture_deg: float) -> tuple[Diagnostic, ...]:
    found = []
    speeds = headers["sound_speed_m_s"]
    if np.ptp(speeds) > 0:
        message = (
            f"the sound speed varies from {speeds.min():.2f} to {speeds.max():.2f} m/s; "
            f"all ranges use that of frame 0, {speeds[0]:.2f} m/s"
        )
        found.append(Diagnostic("variable-sound-speed", message))
    if _has_telephoto_lens(headers[0]):
        message = (
            "the elevation aperture of the telephoto lens is not in the file: "
            f"{elevation_aperture_deg:g} degrees are assumed"
        )
        found.append(Diagnostic("assumed-aperture", message))
    return tuple(found)
