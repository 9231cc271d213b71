"""Natural bounds of stamps and angles in tables: a value beyond them is in another unit."""

from pathlib import Path

import numpy as np

from asfm.errors import AsfmError
from asfm.types import FloatArray

MAX_STAMP_S = 9e9
"""Seconds since 1970 until the year 2255; the clock of the Rerun viewer ends soon after."""
EPOCH_S = (5e8, 9e9)
"""Stamps since 1970 lie here once they are in seconds."""
MAX_MEDIAN_STEP_S = 1e4
"""No sensor is read less often than every three hours, so that stamps further apart are in another unit."""
MAX_LENGTH_M = 1e9
TYPICAL_STEP_S = 0.1
UNITS = ((1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds"))
"""Number of them in a second, and their name."""
ROUNDING_RAD = 1e-3
"""Angles at their bound may lie this far outside after rounding in text."""
MAX_PITCH_RAD, MAX_ROLL_RAD, MAX_BEARING_RAD = np.pi / 2, 2 * np.pi, np.pi
"""Roll may be unwrapped, so that it reaches a full turn."""


def check_stamps(where: Path, timestamps_s: FloatArray, lines: list[int] | None = None) -> None:
    """Check that stamps (N,) can be seconds.

    Args:
        where: the file, for messages.
        timestamps_s: (N,) finite stamps, in any order.
        lines: (N,) their line numbers in a table; None where the file is none, so that messages count from 0.

    Raises:
        AsfmError: a stamp or the median step is beyond every clock in seconds; the message guesses the unit.
    """
    beyond = np.flatnonzero(np.abs(timestamps_s) > MAX_STAMP_S)
    step_s = median_step_s(timestamps_s)
    if len(beyond) == 0 and not step_s > MAX_MEDIAN_STEP_S:
        return
    index = int(beyond[0]) if len(beyond) else 1
    place = f"line {lines[index]}" if lines is not None else f"frame {index}"
    found = f"found {float(timestamps_s[index]):.15g}"
    if len(beyond) == 0:
        found += f", {step_s:.6g} after the one before"
    raise AsfmError(f"{where}, {place}: expected seconds as timestamp_s, {found}: {guess_unit(timestamps_s)}")


def median_step_s(timestamps_s: FloatArray) -> float:
    """Return the median step between stamps (N,), or NaN where there is only one."""
    return float(np.median(np.diff(timestamps_s))) if len(timestamps_s) > 1 else float("nan")


def guess_unit(timestamps_s: FloatArray) -> str:
    """Guess the unit of stamps (N,) that are no seconds, in words that say what to do.

    The largest stamp tells it where it is a time since 1970, else the median step does.
    """
    largest, step = float(np.abs(timestamps_s).max()), median_step_s(timestamps_s)
    by_epoch = [unit for unit in UNITS if EPOCH_S[0] <= largest / unit[0] <= EPOCH_S[1]]
    if by_epoch:
        unit, name = by_epoch[0]
    elif step > TYPICAL_STEP_S:
        unit, name = min(UNITS, key=lambda unit: abs(np.log(step / unit[0] / TYPICAL_STEP_S)))
    else:
        return "no clock counts so many seconds; correct the stamps"
    return f"these look like {name}: divide by 1e{round(np.log10(unit))}"


def check_lengths(where: Path, lines: list[int], lengths_m: FloatArray, name: str) -> None:
    """Check that lengths (N,) can be metres; other arguments as for :func:`check_angles`.

    Raises:
        AsfmError: a length is beyond a million kilometres.
    """
    for index in np.flatnonzero(~(np.abs(lengths_m) <= MAX_LENGTH_M))[:1]:
        found = f"{float(lengths_m[index]):g}"
        raise AsfmError(f"{where}, line {lines[index]}: expected |{name}| <= {MAX_LENGTH_M:g} m, found {found}")


def check_angles(where: Path, lines: list[int], angles_rad: FloatArray, name: str, bound_rad: float) -> None:
    """Check that angles (N,) lie within their bound on both sides, apart from rounding.

    Args:
        where: the file, for messages.
        lines: (N,) line numbers.
        angles_rad: (N,) finite values.
        name: name of the column.
        bound_rad: largest absolute value.

    Raises:
        AsfmError: an angle is beyond; the message guesses that the column is in degrees.
    """
    beyond = np.flatnonzero(np.abs(angles_rad) > bound_rad + ROUNDING_RAD)
    for index in beyond[:1]:
        largest = float(np.abs(angles_rad).max())
        raise AsfmError(
            f"{where}, line {lines[index]}: expected |{name}| <= {bound_rad:.3f}, found {angles_rad[index]:g} "
            f"({len(beyond)} of {len(angles_rad)} values are beyond, up to {largest:g}): "
            f"{'degrees? multiply by pi/180' if largest <= 360 else 'correct the values'}"
        )
