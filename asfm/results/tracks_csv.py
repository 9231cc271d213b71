"""tracks.csv among the results of a run: which observations its tracks hold, and which of them it used."""

from pathlib import Path

import numpy as np

from asfm.datasets.tables import Row, parse_integers, parse_numbers, read_csv
from asfm.errors import AsfmError
from asfm.types import BoolArray, FloatArray, IntArray, Tracks

TRACK_COLUMNS = ("track", "frame", "range_m", "bearing_rad", "sigma_range_m", "sigma_bearing_rad", "used")


def read_tracks(path: Path, frame_count: int) -> tuple[Tracks, BoolArray]:
    """Read the tracks of a run on a sequence of so many frames, and which of the (O,) observations it used.

    Cells of sigma are empty in every row where the run knew none. A run without tracks leaves the header alone.

    Raises:
        AsfmError: naming file and line where a cell is no number, or a row is out of order or out of the sequence.
    """
    position, rows = read_csv(path, TRACK_COLUMNS, may_be_empty=True)
    track = parse_integers(path, rows, position["track"], "track")
    frame = parse_integers(path, rows, position["frame"], "frame")
    used = parse_integers(path, rows, position["used"], "used")
    range_m = parse_numbers(path, rows, position["range_m"], "range_m")
    bearing_rad = parse_numbers(path, rows, position["bearing_rad"], "bearing_rad")
    for bad, expected, values in (
        ((frame < 0) | (frame >= frame_count), f"a frame in 0..{frame_count - 1}", frame),
        ((used < 0) | (used > 1), "0 or 1 as used", used),
        (range_m <= 0, "a range_m above 0", range_m),
        (np.abs(bearing_rad) > np.pi, "a bearing_rad in -pi..pi", bearing_rad),
    ):
        for index in np.flatnonzero(bad)[:1]:
            raise AsfmError(f"{path}, line {rows[index][0]}: expected {expected}, found {values[index]}")
    _check_order(path, rows, track, frame)
    sigma = _read_sigma(path, rows, position)
    return Tracks(track, frame, range_m, bearing_rad, sigma), used == 1


def _check_order(path: Path, rows: list[Row], track: IntArray, frame: IntArray) -> None:
    """Tracks count 0, 1, 2 ... without a gap; within a track the frames rise."""
    jump = np.diff(track, prepend=-1)
    wrong = (jump < 0) | (jump > 1) | ((jump == 0) & (np.diff(frame, prepend=-1) <= 0))
    for index in np.flatnonzero(wrong)[:1]:
        before = "the header" if index == 0 else f"track {track[index - 1]}, frame {frame[index - 1]}"
        raise AsfmError(
            f"{path}, line {rows[index][0]}: expected a later frame of the same track, or the next track, after "
            f"{before}, found track {track[index]}, frame {frame[index]}"
        )


def _read_sigma(path: Path, rows: list[Row], position: dict[str, int]) -> FloatArray | None:
    names = ("sigma_range_m", "sigma_bearing_rad")
    if not any(cells[position[name]] for _, cells in rows for name in names):
        return None
    sigma = np.stack([parse_numbers(path, rows, position[name], name) for name in names], axis=1)
    for index, axis in np.argwhere(sigma <= 0)[:1]:
        found = sigma[index, axis]
        raise AsfmError(f"{path}, line {rows[index][0]}: expected a {names[axis]} above 0, found {found}")
    return sigma
