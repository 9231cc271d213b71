"""Reader of Blueprint Oculus recordings: files of consecutive network messages as received (.raw).

The layout is that of the maker's public SDK: a header of 16 bytes, the fire message that requested the ping, the ping's
own header, a table of bearings, and the image range by range. Messages other than simple ping results are skipped.
"""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asfm.datasets.oculus.messages import HIGH_FREQUENCY, LOW_FREQUENCY, Ping, find_pings, is_message
from asfm.diagnostics import Diagnostic
from asfm.errors import AsfmError
from asfm.geometry.sonar import SonarModel
from asfm.regular_file import is_regular, open_file
from asfm.sequence import Sequence
from asfm.types import FloatArray, Frame, ImageArray

ELEVATION_APERTURE_DEG = {LOW_FREQUENCY: 20.0, HIGH_FREQUENCY: 12.0}
"""By frequency mode; the file does not state it."""
RATES_HZ = {0: 10.0, 1: 15.0, 2: 40.0, 3: 5.0, 4: 2.0}
"""Maximum ping rate by the code in the fire message; recordings also hold codes that are not listed."""
DEFAULT_RATE_HZ = 10.0
"""For other codes."""
MIN_MEDIAN_STEP_S, MAX_MEDIAN_STEP_S = 0.005, 60.0
"""Plausible median time between pings; outside of it the clock does not count seconds."""
RANGE_STEP_TOLERANCE = 0.01
"""Relative change that the measured sound speed explains; a larger one means that the range setting was changed."""


@dataclass(frozen=True)
class OculusPings:
    """Location of the images of one recording."""

    path: Path
    timestamps_s: FloatArray
    pings: tuple[Ping, ...]
    scale: float
    """Image value per unit of amplitude, after gains and gamma are removed."""


def is_oculus(path: Path) -> bool:
    """Return whether a path is an Oculus recording, by its first message."""
    if not is_regular(path):
        return False
    with open_file(path, "an Oculus recording") as file:
        return is_message(file.read(16))


def read_oculus(path: Path, elevation_aperture_deg: float | None = None) -> Sequence:
    """Open an Oculus recording.

    Row i lies at (i + 0.5) times the range resolution. Bearings in the file are positive to starboard, so the columns
    are flipped. The gamma stated in the header is inverted, so that images are proportional to the amplitude: on a real
    ping of empty water, detectors then reach the false-alarm rate that they are set to, and a twentieth of it
    otherwise. Samples of 8 bits are scaled by 1 / 255. Wider samples, and rows with gains, which are divided by the
    square root of the gain, are scaled by the strongest echo in the file, because how much of their span is used
    depends on the settings. Heading, pitch and roll of version 2 have no stated accuracy and are left out.

    Args:
        path: the file.
        elevation_aperture_deg: not stated in the file; by default 20 degrees at the low frequency and 12 at the high.

    Returns:
        The sequence. Pings are evenly spaced in time where their clock is unusable, as it always is in version 1.

    Raises:
        AsfmError: the file is cut off or damaged, holds no ping, or the sonar's settings change.
    """
    pings = find_pings(path)
    _check_settings(path, pings)
    timestamps_s, stamp_diagnostics = _choose_timestamps(pings)
    frames = OculusPings(path, timestamps_s, pings, _compute_scale(path, pings))
    return Sequence(
        name=path.stem,
        sonar=_make_sonar(pings[0], elevation_aperture_deg),
        timestamps_s=timestamps_s,
        read_frame=partial(read_oculus_frame, frames),
        kind="oculus",
        diagnostics=(*stamp_diagnostics, *_diagnose(pings, elevation_aperture_deg)),
    )


def read_oculus_frame(frames: OculusPings, index: int) -> Frame:
    """Read the image of one ping, column 0 starboard.

    Raises:
        AsfmError: the file was cut off after it was opened, or a row has a gain of 0.
        IndexError: there is no such frame.
    """
    if not 0 <= index < len(frames.pings):
        raise IndexError(f"frame {index} of a sequence with frames 0..{len(frames.pings) - 1}")
    amplitudes = _read_amplitudes(frames.path, index, frames.pings[index])
    image: ImageArray = np.ascontiguousarray(np.minimum(amplitudes[:, ::-1] * frames.scale, 1.0), dtype=np.float32)
    return Frame(index, float(frames.timestamps_s[index]), image, np.zeros(image.shape, dtype=bool))


def _make_sonar(ping: Ping, elevation_aperture_deg: float | None) -> SonarModel:
    """Return the sonar model that the header of a ping describes, its bearings increasing to port."""
    if elevation_aperture_deg is None:
        elevation_aperture_deg = ELEVATION_APERTURE_DEG.get(ping.master_mode, ELEVATION_APERTURE_DEG[HIGH_FREQUENCY])
    return SonarModel(
        name=f"Oculus {ping.frequency_name}, {ping.shape[1]} beams",
        range_m=ping.range_step_m * (np.arange(ping.shape[0], dtype=np.float64) + 0.5),
        bearing_rad=np.radians(-np.array(ping.bearings_deg)[::-1]),
        elevation_aperture_rad=float(np.radians(elevation_aperture_deg)),
    )


def _read_amplitudes(path: Path, index: int, ping: Ping) -> FloatArray:
    """Read (ranges, beams) amplitudes in the file's order of beams, with row gains and gamma removed."""
    with open_file(path, "an Oculus recording") as file:
        file.seek(ping.image_start)
        content = file.read(ping.image_bytes)
    if len(content) < ping.image_bytes:
        raise AsfmError(f"{path}, frame {index}: expected {ping.image_bytes} bytes of samples, found {len(content)}")
    rows: NDArray[Any] = np.frombuffer(content, dtype=ping.row_type)
    amplitudes: FloatArray = rows["samples"].astype(np.float64)
    if ping.has_gains:
        gains = rows["gain"].astype(np.float64)
        for row in np.flatnonzero(gains == 0)[:1]:
            raise AsfmError(f"{path}, frame {index}: expected a gain above 0 in every row, found 0 in row {row}")
        amplitudes /= np.sqrt(gains)[:, None]
    return amplitudes if ping.gamma == 1 else np.asarray(amplitudes ** (1 / ping.gamma))


def _compute_scale(path: Path, pings: tuple[Ping, ...]) -> float:
    """Return the image value per unit of amplitude."""
    if pings[0].sample_type == np.uint8 and not pings[0].has_gains:
        return float(255 ** (-1 / pings[0].gamma))
    peak = max(float(_read_amplitudes(path, index, ping).max()) for index, ping in enumerate(pings))
    return 1 / peak if peak > 0 else 1.0


def _check_settings(path: Path, pings: tuple[Ping, ...]) -> None:
    """Check that the settings that define the images are the same in all pings."""
    first = pings[0]
    for index, ping in enumerate(pings):
        for name, expected, found in (
            ("ranges x beams", first.shape, ping.shape),
            ("message version", first.version, ping.version),
            ("frequency mode", first.master_mode, ping.master_mode),
            ("bits per sample", 8 * first.sample_type.itemsize, 8 * ping.sample_type.itemsize),
            ("gamma", round(first.gamma, 3), round(ping.gamma, 3)),
            ("row gains", first.has_gains, ping.has_gains),
        ):
            if expected != found:
                raise _settings_error(path, index, name, str(expected), str(found))
        if abs(ping.range_step_m - first.range_step_m) > RANGE_STEP_TOLERANCE * first.range_step_m:
            steps_m = f"{first.range_step_m:.6g} m", f"{ping.range_step_m:.6g} m"
            raise _settings_error(path, index, "range resolution", *steps_m)
        if ping.bearings_deg != first.bearings_deg:
            raise _settings_error(path, index, "bearings", _format_bearings(first), _format_bearings(ping))


def _format_bearings(ping: Ping) -> str:
    return f"{ping.bearings_deg[0]:g}..{ping.bearings_deg[-1]:g} deg"


def _settings_error(path: Path, index: int, name: str, expected: str, found: str) -> AsfmError:
    return AsfmError(
        f"{path}, frame {index}: expected {name} {expected} as in frame 0, found {found}: "
        "split the recording where its settings change"
    )


def _choose_timestamps(pings: tuple[Ping, ...]) -> tuple[FloatArray, tuple[Diagnostic, ...]]:
    """Return the stamps (N,): the sonar's clock where it increases and counts seconds, else evenly spaced."""
    clock_s = np.array([ping.start_time_s for ping in pings])
    steps_s = np.diff(clock_s)
    increases = np.isfinite(clock_s).all() and (steps_s > 0).all()
    if increases and (len(steps_s) == 0 or MIN_MEDIAN_STEP_S <= np.median(steps_s) <= MAX_MEDIAN_STEP_S):
        return clock_s, ()
    if len(pings) == 1:
        return np.zeros(1), ()
    rate_hz = RATES_HZ.get(pings[0].rate_code, DEFAULT_RATE_HZ)
    reason = "the maximum as set" if pings[0].rate_code in RATES_HZ else "as the ping rate is not stated"
    message = f"the pings' time stamps are unusable: frames are spaced evenly at {rate_hz:g} Hz, {reason}"
    return np.arange(len(pings)) / rate_hz, (Diagnostic("unreliable-stamps", message),)


def _diagnose(pings: tuple[Ping, ...], elevation_aperture_deg: float | None) -> tuple[Diagnostic, ...]:
    found = []
    steps_m = np.array([ping.range_step_m for ping in pings])
    if np.ptp(steps_m) > 0:
        message = (
            f"the range resolution varies from {steps_m.min():.6g} to {steps_m.max():.6g} m; "
            f"all ranges use that of frame 0, {steps_m[0]:.6g} m"
        )
        found.append(Diagnostic("variable-range-resolution", message))
    mode = pings[0].master_mode
    if mode not in ELEVATION_APERTURE_DEG and elevation_aperture_deg is None:
        message = (
            f"the frequency mode {mode} is unknown: an elevation aperture of "
            f"{ELEVATION_APERTURE_DEG[HIGH_FREQUENCY]:g} degrees is assumed"
        )
        found.append(Diagnostic("assumed-aperture", message))
    return tuple(found)
