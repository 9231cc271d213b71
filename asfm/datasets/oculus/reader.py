"""Reader of Blueprint Oculus recordings: the sonar's network messages, one after another, as they came (.raw).

The layout is that of the maker's public SDK: a header of 16 bytes, the fire message that asked for the ping, the ping's
own header, a table of bearings and the image, range by range. Messages that are no simple ping result are skipped.
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
from asfm.sequence import Sequence
from asfm.types import FloatArray, Frame, ImageArray

ELEVATION_APERTURE_DEG = {LOW_FREQUENCY: 20.0, HIGH_FREQUENCY: 12.0}
RATES_HZ = {0: 10.0, 1: 15.0, 2: 40.0, 3: 5.0, 4: 2.0}
"""Pings a second at most, by the fire message's code; the code is not always one of these."""
USUAL_RATE_HZ = 10.0
STEPS_S = (0.005, 60.0)
"""Typical steps between pings that a clock in seconds can have."""
RESOLUTION_TOLERANCE = 0.01
"""The rows follow the measured speed of sound; beyond this, somebody changed the range."""


@dataclass(frozen=True)
class OculusPings:
    """Where the images of one recording lie."""

    path: Path
    timestamps_s: FloatArray
    pings: tuple[Ping, ...]
    scale: float
    """What one unit of amplitude, gains and gamma taken off, is worth in the image."""


def is_oculus(path: Path) -> bool:
    """Tell by its first message whether a file is an Oculus recording."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return is_message(file.read(16))


def read_oculus(path: Path, elevation_aperture_deg: float | None = None) -> Sequence:
    """Open an Oculus recording.

    Row i lies at (i + 0.5) times the range resolution. The table's bearings are positive to starboard and rise; the
    columns are turned round once, here. The gamma that the header states is undone: on a real ping of empty water
    detectors then give the false alarms that they are set to, and a twentieth of them otherwise. Samples of 8 bits run
    from 0 to 1. Of wider ones, and of rows with gains, which are divided by the gain's root, the strongest in the file
    is 1, for how much of their span is used depends on the settings. The clock of version 1 has no trustworthy unit:
    such pings are spaced evenly. Heading, pitch and roll of version 2 have no stated accuracy and are left out.

    Args:
        path: the file.
        elevation_aperture_deg: not in the file; 20 degrees at the low frequency and 12 at the high one where not given.

    Raises:
        AsfmError: the file is cut off or damaged, holds no ping, or the sonar's settings change.
    """
    pings = find_pings(path)
    _check_settings(path, pings)
    timestamps_s, stamp_diagnostics = _stamp_pings(pings)
    first = pings[0]
    aperture_deg = elevation_aperture_deg
    if aperture_deg is None:
        aperture_deg = ELEVATION_APERTURE_DEG.get(first.master_mode, ELEVATION_APERTURE_DEG[HIGH_FREQUENCY])
    sonar = SonarModel(
        name=f"Oculus {first.frequency_name}, {first.shape[1]} beams",
        range_m=first.range_step_m * (np.arange(first.shape[0], dtype=np.float64) + 0.5),
        bearing_rad=np.radians(-np.array(first.bearings_deg)[::-1]),
        elevation_aperture_rad=float(np.radians(aperture_deg)),
    )
    frames = OculusPings(path, timestamps_s, pings, _find_scale(path, pings))
    return Sequence(
        name=path.stem,
        sonar=sonar,
        timestamps_s=timestamps_s,
        read_frame=partial(read_oculus_frame, frames),
        kind="oculus",
        diagnostics=(*stamp_diagnostics, *_diagnose(pings, elevation_aperture_deg)),
    )


def read_oculus_frame(frames: OculusPings, index: int) -> Frame:
    """Read one ping's image, starboard first."""
    if not 0 <= index < len(frames.pings):
        raise IndexError(f"frame {index} of a sequence with frames 0..{len(frames.pings) - 1}")
    echoes = _read_echoes(frames.path, index, frames.pings[index])
    image: ImageArray = np.ascontiguousarray(np.minimum(echoes[:, ::-1] * frames.scale, 1.0), dtype=np.float32)
    return Frame(index, float(frames.timestamps_s[index]), image, np.zeros(image.shape, dtype=bool))


def _read_echoes(path: Path, index: int, ping: Ping) -> FloatArray:
    """Read (ranges, beams) amplitudes in the file's order of beams, the rows' gains and the gamma taken off."""
    with path.open("rb") as file:
        file.seek(ping.image_at)
        content = file.read(ping.image_bytes)
    if len(content) < ping.image_bytes:
        raise AsfmError(f"{path}, frame {index}: expected {ping.image_bytes} bytes of samples, found {len(content)}")
    rows: NDArray[Any] = np.frombuffer(content, dtype=ping.row_type)
    echoes: FloatArray = rows["samples"].astype(np.float64)
    if ping.has_gains:
        gains = rows["gain"].astype(np.float64)
        for row in np.flatnonzero(gains == 0)[:1]:
            raise AsfmError(f"{path}, frame {index}: expected a gain above 0 in every row, found 0 in row {row}")
        echoes /= np.sqrt(gains)[:, None]
    return echoes if ping.gamma == 1 else np.asarray(echoes ** (1 / ping.gamma))


def _find_scale(path: Path, pings: tuple[Ping, ...]) -> float:
    if pings[0].sample_type == np.uint8 and not pings[0].has_gains:
        return float(255 ** (-1 / pings[0].gamma))
    peak = max(float(_read_echoes(path, index, ping).max()) for index, ping in enumerate(pings))
    return 1 / peak if peak > 0 else 1.0


def _check_settings(path: Path, pings: tuple[Ping, ...]) -> None:
    first = pings[0]
    for index, ping in enumerate(pings):
        for name, expected, found in (
            ("ranges x beams", first.shape, ping.shape),
            ("message version", first.version, ping.version),
            ("frequency mode", first.master_mode, ping.master_mode),
            ("bits a sample", 8 * first.sample_type.itemsize, 8 * ping.sample_type.itemsize),
            ("gamma", round(first.gamma, 3), round(ping.gamma, 3)),
            ("row gains", first.has_gains, ping.has_gains),
        ):
            if expected != found:
                raise _explain_change(path, index, name, str(expected), str(found))
        if abs(ping.range_step_m - first.range_step_m) > RESOLUTION_TOLERANCE * first.range_step_m:
            steps_m = f"{first.range_step_m:.6g} m", f"{ping.range_step_m:.6g} m"
            raise _explain_change(path, index, "range resolution", *steps_m)
        if ping.bearings_deg != first.bearings_deg:
            raise _explain_change(path, index, "bearings", _describe(first), _describe(ping))


def _describe(ping: Ping) -> str:
    return f"{ping.bearings_deg[0]:g}..{ping.bearings_deg[-1]:g} deg"


def _explain_change(path: Path, index: int, name: str, expected: str, found: str) -> AsfmError:
    return AsfmError(
        f"{path}, frame {index}: expected {name} {expected} as in frame 0, found {found}: "
        "split the recording where its settings change"
    )


def _stamp_pings(pings: tuple[Ping, ...]) -> tuple[FloatArray, tuple[Diagnostic, ...]]:
    """Take the sonar's clock where it is one of seconds that rise, and else space the pings evenly."""
    clock_s = np.array([ping.start_time_s for ping in pings])
    steps_s = np.diff(clock_s)
    usable = np.isfinite(clock_s).all() and (steps_s > 0).all()
    if usable and (len(steps_s) == 0 or STEPS_S[0] <= np.median(steps_s) <= STEPS_S[1]):
        return clock_s, ()
    if len(pings) == 1:
        return np.zeros(1), ()
    rate_hz = RATES_HZ.get(pings[0].rate_code, USUAL_RATE_HZ)
    said = "as the ping rate asks" if pings[0].rate_code in RATES_HZ else "as is usual, for the ping rate is not stated"
    message = f"the pings' time stamps are unusable: frames are spaced evenly at {rate_hz:g} Hz, {said}"
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
