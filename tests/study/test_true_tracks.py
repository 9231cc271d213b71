"""True tracks: each is one point of the scene, seen in consecutive frames at its exact place."""

from pathlib import Path

import numpy as np
import pytest

from asfm.evaluation.true_positions import look_up_elevation
from asfm.geometry.poses import invert, transform
from asfm.geometry.sonar import back_project, project
from asfm.simulation.simulate import SimulatedSequence, simulate
from asfm.study.true_tracks import TrueTracks, find_true_tracks
from asfm.types import FloatArray

POINTS = 40


@pytest.fixture(scope="module")
def tank() -> SimulatedSequence:
    return simulate("tank", "didson", 6)


@pytest.fixture(scope="module")
def poses(tank: SimulatedSequence) -> FloatArray:
    assert tank.sequence.groundtruth is not None
    return tank.sequence.groundtruth.world_from_vehicle


@pytest.fixture(scope="module")
def tracks(tank: SimulatedSequence, poses: FloatArray) -> TrueTracks:
    return find_true_tracks(poses, tank.sequence.sonar, tank.read_truth, POINTS, np.random.default_rng(0))


def test_every_frame_has_the_points_that_were_asked_for(tracks: TrueTracks) -> None:
    assert np.bincount(tracks.frame).tolist() == [POINTS] * 6
    assert np.bincount(tracks.track).max() == 6 and np.bincount(tracks.track).mean() > 2
    same = np.diff(tracks.track) == 0
    assert (np.diff(tracks.track)[~same] == 1).all() and (np.diff(tracks.frame)[same] == 1).all()


def test_the_observations_of_a_track_are_those_of_one_visible_point(
    tank: SimulatedSequence, poses: FloatArray, tracks: TrueTracks
) -> None:
    sonar, elevations = tank.sequence.sonar, [tank.read_truth(frame).elevation_rad for frame in range(6)]
    for track in range(0, int(tracks.track.max()) + 1, 7):
        rows = np.flatnonzero(tracks.track == track)
        first = rows[0]
        pixel = np.array(
            [[sonar.row_at_range(tracks.range_m[first]), sonar.column_at_bearing(tracks.bearing_rad[first])]]
        )
        elevation_rad, known = look_up_elevation(pixel, elevations[tracks.frame[first]])
        assert known.all()
        at_m = back_project(tracks.range_m[first], tracks.bearing_rad[first], elevation_rad[0])
        world_m = transform(poses[tracks.frame[first]], at_m)
        for row in rows:
            range_m, bearing_rad, elevation = project(transform(invert(poses[tracks.frame[row]]), world_m))
            assert range_m == pytest.approx(tracks.range_m[row], abs=1e-9)
            assert bearing_rad == pytest.approx(tracks.bearing_rad[row], abs=1e-9)
            assert abs(elevation) <= sonar.elevation_aperture_rad / 2


def test_the_same_generator_gives_the_same_tracks_and_files_keep_them(
    tank: SimulatedSequence, poses: FloatArray, tracks: TrueTracks, tmp_path: Path
) -> None:
    again = find_true_tracks(poses, tank.sequence.sonar, tank.read_truth, POINTS, np.random.default_rng(0))
    again.write(tmp_path / "tracks.npz")
    for name, values in vars(TrueTracks.read(tmp_path / "tracks.npz")).items():
        np.testing.assert_array_equal(values, getattr(tracks, name))


def test_hidden_points_are_not_seen(tank: SimulatedSequence, poses: FloatArray) -> None:
    """Where the surface in a pixel lies at another elevation than the point, the point ends there."""

    class Raised:
        def __init__(self, frame: int) -> None:
            self.elevation_rad = tank.read_truth(frame).elevation_rad + (np.radians(3) if frame >= 3 else 0)

    read: object = Raised
    found = find_true_tracks(poses, tank.sequence.sonar, read, POINTS, np.random.default_rng(0))  # type: ignore[arg-type]
    first, last = (np.full(found.track.max() + 1, fill) for fill in (99, -1))
    np.minimum.at(first, found.track, found.frame)
    np.maximum.at(last, found.track, found.frame)
    assert not ((first < 3) & (last >= 3)).any()
