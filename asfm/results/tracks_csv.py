"""tracks.csv: the observations of all tracks, and which of them the final graph used."""

from pathlib import Path

import numpy as np

from asfm.datasets.tables import Row, parse_integers, parse_numbers, read_csv
from asfm.errors import AsfmError
from asfm.results.output_file import require_finite, write_lines
from asfm.types import BoolArray, FloatArray, IntArray, Tracks

SIGMA_COLUMNS = ("sigma_range_m", "sigma_bearing_rad")
COLUMNS = ("track", "frame", "range_m", "bearing_rad", *SIGMA_COLUMNS, "used", "keypoint", "landmark")


def write_tracks(path: Path, tracks: Tracks, observed: BoolArray, landmark_track: IntArray) -> None:
    """Write one CSV row per observation; numbers read back exactly, ``used`` is 1 or 0.

    ``keypoint`` is the index of the keypoint in features.h5, ``landmark`` the row of the landmark in points.ply. Cells
    are empty where there is no sigma, keypoint or landmark.

    Args:
        path: of the table.
        tracks: (O,) observations.
        observed: (O,) true for those that entered the final graph.
        landmark_track: (L,) tracks of the landmarks, in the order of points.ply.

    Raises:
        AsfmError: the file cannot be written.
        ValueError: a number is not finite: a defect of the caller.
    """
    numbers = [tracks.range_m, tracks.bearing_rad]
    numbers += [] if tracks.sigma is None else [tracks.sigma[:, 0], tracks.sigma[:, 1]]
    require_finite("tracks", *numbers)
    texts = [[repr(value) for value in column.tolist()] for column in numbers]
    texts += [] if tracks.sigma is not None else [[""] * len(tracks)] * 2
    landmark = np.full(tracks.count, -1, dtype=np.int64)
    landmark[landmark_track] = np.arange(len(landmark_track))
    keypoint = np.full(len(tracks), -1) if tracks.keypoint is None else tracks.keypoint
    whole = (tracks.track, tracks.frame, observed.astype(np.int64), keypoint, landmark[tracks.track])
    first, second, *others = ([str(value) if value >= 0 else "" for value in column.tolist()] for column in whole)
    rows = zip(first, second, *texts, *others, strict=True)
    write_lines(path, [",".join(COLUMNS), *map(",".join, rows)])


def read_tracks(path: Path, frame_count: int) -> tuple[Tracks, BoolArray, IntArray]:
    """Read the tracks of a run.

    Args:
        path: of the table; a run without tracks wrote the header alone.
        frame_count: number of frames of the sequence.

    Returns:
        The tracks, without sigmas and keypoints where all of those cells are empty; (O,) true for the observations that
        the final graph used; (T,) the row of each track's landmark in points.ply, -1 without one.

    Raises:
        AsfmError: a cell is not a number, or a row is out of order or out of the sequence; names file and line.
    """
    position, rows = read_csv(path, COLUMNS, may_be_empty=True)
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
    keypoint, landmark = (_read_indices(path, rows, position[name], name) for name in ("keypoint", "landmark"))
    tracks = Tracks(track, frame, range_m, bearing_rad, sigma, keypoint if (keypoint >= 0).all() else None)
    of_track = np.full(tracks.count, -1, dtype=np.int64)
    of_track[track] = landmark
    return tracks, used == 1, of_track


def _check_order(path: Path, rows: list[Row], track: IntArray, frame: IntArray) -> None:
    """Check that tracks count 0, 1, 2 ... without a gap, and that frames rise within a track."""
    step = np.diff(track, prepend=-1)
    wrong = (step < 0) | (step > 1) | ((step == 0) & (np.diff(frame, prepend=-1) <= 0))
    for index in np.flatnonzero(wrong)[:1]:
        before = "the header" if index == 0 else f"track {track[index - 1]}, frame {frame[index - 1]}"
        raise AsfmError(
            f"{path}, line {rows[index][0]}: expected a later frame of the same track, or the next track, after "
            f"{before}, found track {track[index]}, frame {frame[index]}"
        )


def _read_indices(path: Path, rows: list[Row], column: int, name: str) -> IntArray:
    """Return (O,) indices of zero or more; -1 where the cell is empty."""
    index = np.full(len(rows), -1, dtype=np.int64)
    filled = [number for number, (_, cells) in enumerate(rows) if cells[column].strip()]
    index[filled] = parse_integers(path, [rows[number] for number in filled], column, name)
    for number in (number for number in filled if index[number] < 0):
        raise AsfmError(f"{path}, line {rows[number][0]}: expected a {name} of 0 or more, found {index[number]}")
    return index


def _read_sigma(path: Path, rows: list[Row], position: dict[str, int]) -> FloatArray | None:
    """Return the (O, 2) sigmas of range (m) and bearing (rad), or None where all cells are empty."""
    if not any(cells[position[name]] for _, cells in rows for name in SIGMA_COLUMNS):
        return None
    sigma = np.stack([parse_numbers(path, rows, position[name], name) for name in SIGMA_COLUMNS], axis=1)
    for index, axis in np.argwhere(sigma <= 0)[:1]:
        found = sigma[index, axis]
        raise AsfmError(f"{path}, line {rows[index][0]}: expected a {SIGMA_COLUMNS[axis]} above 0, found {found}")
    return sigma
