"""tracks.csv: reads back exactly, and malformed rows are one-line errors."""

from pathlib import Path

import numpy as np
import pytest

from asfm.errors import AsfmError
from asfm.results.tracks_csv import read_tracks, write_tracks
from asfm.types import BoolArray, Tracks


def make_tracks(count: int, stated: bool = True, seed: int = 0) -> tuple[Tracks, BoolArray]:
    """Return tracks of 2 to 5 observations in 9 frames, with numbers of full precision."""
    rng = np.random.default_rng(seed)
    frames = [np.sort(rng.choice(9, rng.integers(2, 6), replace=False)) for _ in range(count)]
    track = np.repeat(np.arange(count), [len(frame) for frame in frames])
    total = len(track)
    sigma = rng.uniform(1e-9, 0.1, (total, 2)) if stated else None
    frame = np.concatenate([np.zeros(0, int), *frames])
    keypoint = rng.integers(0, 500, total) if stated else None
    tracks = Tracks(track, frame, rng.uniform(0.1, 99, total), rng.normal(0, 0.3, total), sigma, keypoint)
    return tracks, rng.random(total) < 0.7


HEADER = "track,frame,range_m,bearing_rad,sigma_range_m,sigma_bearing_rad,used,keypoint,landmark"


@pytest.mark.parametrize(("count", "stated"), [(0, False), (1, True), (40, True), (40, False)])
def test_tracks_read_back_exactly(tmp_path: Path, count: int, stated: bool) -> None:
    tracks, observed = make_tracks(count, stated)
    landmark_track = np.arange(1, count, 3)
    write_tracks(tmp_path / "tracks.csv", tracks, observed, landmark_track)
    read, used, landmark = read_tracks(tmp_path / "tracks.csv", 9)
    np.testing.assert_array_equal(np.flatnonzero(landmark >= 0), landmark_track)
    np.testing.assert_array_equal(landmark[landmark_track], np.arange(len(landmark_track)))
    for name in ("track", "frame", "range_m", "bearing_rad"):
        np.testing.assert_array_equal(getattr(read, name), getattr(tracks, name))
    np.testing.assert_array_equal(used, observed)
    assert (read.sigma is None) == (tracks.sigma is None or not count)
    if read.sigma is not None and tracks.sigma is not None:
        np.testing.assert_array_equal(read.sigma, tracks.sigma)
    if stated:
        np.testing.assert_array_equal(read.keypoint, tracks.keypoint)
    write_tracks(tmp_path / "again.csv", read, used, landmark_track)
    assert (tmp_path / "again.csv").read_bytes() == (tmp_path / "tracks.csv").read_bytes()


def test_tracks_with_nan_are_a_defect(tmp_path: Path) -> None:
    tracks, observed = make_tracks(3)
    tracks.bearing_rad[4] = np.nan
    with pytest.raises(ValueError, match="row 4"):
        write_tracks(tmp_path / "tracks.csv", tracks, observed, np.zeros(0, dtype=np.int64))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        (
            ["0,1,2.0,0.1,,,1,5,0", "0,1,2.0,0.1,,,1,5,0"],
            "line 3: expected a later frame of the same track.*found track 0, f",
        ),
        (["1,1,2.0,0.1,,,1,5,0"], "line 2: .*after the header, found track 1"),
        (["0,1,2.0,0.1,,,1,5,0", "2,1,2.0,0.1,,,1,5,0"], "line 3: .*found track 2, frame 1"),
        (["0,9,2.0,0.1,,,1,5,0"], r"line 2: expected a frame in 0\.\.8, found 9"),
        (["0,1,2.0,0.1,,,2,5,0"], "line 2: expected 0 or 1 as used, found 2"),
        (["0,1,-2.0,0.1,,,1,5,0"], "line 2: expected a range_m above 0, found -2.0"),
        (["0,1,nan,0.1,,,1,5,0"], "line 2: expected a finite range_m, found nan"),
        (["0,1,2.0,7,,,1,5,0"], "line 2: expected a bearing_rad in"),
        (["0,1,2.0,0.1,0.01,,1,5,0"], "line 2: expected a number as sigma_bearing_rad, found ''"),
        (
            ["0,1,2.0,0.1,0.01,0.02,1,5,0", "0,2,2.0,0.1,,,1,5,0"],
            "line 3: expected a number as sigma_range_m, found ''",
        ),
        (["0,1,2.0,0.1,0.01,0,1,5,0"], "line 2: expected a sigma_bearing_rad above 0"),
        (["0.5,1,2.0,0.1,,,1,5,0"], "line 2: expected a whole number as track, found '0.5'"),
        (["0,9999999999999999999999,2.0,0.1,,,1,5,0"], "line 2: expected a whole number as frame"),
        (["0,1,2.0,0.1"], "line 2: expected 9 cells, found 4"),
        (["0,1,2.0,0.1,,,1,-3,0"], "line 2: expected a keypoint of 0 or more, found -3"),
        (["0,1,2.0,0.1,,,1,x,0"], "line 2: expected a whole number as keypoint, found 'x'"),
    ],
)
def test_malformed_rows_are_one_line_errors_with_file_and_line(tmp_path: Path, rows: list[str], expected: str) -> None:
    (tmp_path / "tracks.csv").write_text("\n".join([HEADER, *rows]))
    with pytest.raises(AsfmError, match=rf"^[^\n]*tracks\.csv, {expected}[^\n]*$"):
        read_tracks(tmp_path / "tracks.csv", 9)


def test_missing_file_and_wrong_header_are_one_line_errors(tmp_path: Path) -> None:
    with pytest.raises(AsfmError, match=r"^[^\n]*tracks\.csv: expected a table, found none$"):
        read_tracks(tmp_path / "tracks.csv", 9)
    (tmp_path / "tracks.csv").write_text("timestamp_s,image\n")
    with pytest.raises(AsfmError, match=rf"^[^\n]*line 1: expected the header {HEADER}, found timestamp_s,image$"):
        read_tracks(tmp_path / "tracks.csv", 9)
