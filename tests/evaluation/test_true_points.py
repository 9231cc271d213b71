"""True points of tracks: points planted in the elevations of the frames, foreign observations, and the noise."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.evaluation.true_points import find_true_points, measure_noise
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import SonarModel, project
from asfm.types import FloatArray, FrameTruth, Tracks

SONAR = SonarModel.evenly_spaced("made up", (1.0, 9.0), (-0.6, 0.6), (1600, 800), np.radians(30))
FRAMES, POINTS = 6, 40
SIGMA = np.array([0.006, 0.002])


class _World:
    """Points in view of every frame, and the true elevations of the frames."""

    def __init__(self, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        turn = Rotation.from_rotvec(rng.normal(scale=0.03, size=(FRAMES, 3)))
        self.sonar_from_world = invert(make_pose(rng.normal(scale=0.1, size=(FRAMES, 3)), turn))
        self.xyz_m = np.stack(
            [rng.uniform(3, 7, POINTS), rng.uniform(-1.2, 1.2, POINTS), rng.uniform(-0.3, 0.3, POINTS)], axis=1
        )
        track, frame = np.repeat(np.arange(POINTS), FRAMES), np.tile(np.arange(FRAMES), POINTS)
        self.range_m, self.bearing_rad, self.elevation_rad = project(
            transform(self.sonar_from_world[frame], self.xyz_m[track])
        )
        self.tracks = Tracks(track, frame, self.range_m, self.bearing_rad)

    def observe(self, sigma: FloatArray, seed: int = 1) -> Tracks:
        noise = np.random.default_rng(seed).normal(size=(len(self.tracks), 2)) * sigma
        return Tracks(self.tracks.track, self.tracks.frame, self.range_m + noise[:, 0], self.bearing_rad + noise[:, 1])

    def read_truth(self, index: int) -> FrameTruth:
        elevation_rad = np.full(SONAR.shape, np.nan)
        here = self.tracks.frame == index
        pixel = (
            SONAR.row_at_range(self.range_m[here]).astype(int),
            SONAR.column_at_bearing(self.bearing_rad[here]).astype(int),
        )
        elevation_rad[pixel] = self.elevation_rad[here]
        return FrameTruth(elevation_rad, np.zeros(SONAR.shape, np.float32))


def test_planted_points_are_found() -> None:
    world = _World()
    found = find_true_points(world.tracks, SONAR, world.sonar_from_world, world.read_truth)
    assert found.known.all() and found.inlier.all()
    np.testing.assert_allclose(found.xyz_m, world.xyz_m, atol=1e-9)
    np.testing.assert_allclose(found.range_m, world.range_m, atol=1e-9)
    np.testing.assert_allclose(found.bearing_rad, world.bearing_rad, atol=1e-9)


def test_an_observation_of_another_point_is_no_inlier() -> None:
    world = _World()
    range_m = world.range_m.copy()
    range_m[[2, FRAMES + 4]] += 0.5
    wrong = Tracks(world.tracks.track, world.tracks.frame, range_m, world.bearing_rad)
    found = find_true_points(wrong, SONAR, world.sonar_from_world, world.read_truth)
    assert np.flatnonzero(~found.inlier).tolist() == [2, FRAMES + 4]
    np.testing.assert_allclose(found.xyz_m, world.xyz_m, atol=1e-9)


def test_tracks_where_nothing_echoes_have_no_point() -> None:
    world = _World()
    silent = FrameTruth(np.full(SONAR.shape, np.nan), np.zeros(SONAR.shape, np.float32))
    found = find_true_points(world.tracks, SONAR, world.sonar_from_world, lambda index: silent)
    assert not found.known.any() and not found.inlier.any() and not found.xyz_m.any()
    assert measure_noise(world.tracks, found) is None


@pytest.mark.parametrize(("views", "scale"), [(2, 0.3), (FRAMES, 1.0)])
def test_planted_noise_is_measured_with_few_views_and_many(views: int, scale: float) -> None:
    """The small noise keeps every observation near the only pixel in which its point echoes."""
    estimates = []
    for seed in range(10):
        world = _World(seed)
        tracks = world.observe(scale * SIGMA, seed)
        tracks = tracks.select(tracks.frame < views)
        noise = measure_noise(tracks, find_true_points(tracks, SONAR, world.sonar_from_world, world.read_truth))
        assert noise is not None
        estimates.append(noise)
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(estimates), axis=0)), scale * SIGMA, rtol=0.1)


def test_no_tracks_have_no_points() -> None:
    world = _World()
    none = world.tracks.select(np.zeros(len(world.tracks), dtype=bool))
    found = find_true_points(none, SONAR, world.sonar_from_world, world.read_truth)
    assert len(found.xyz_m) == 0 and measure_noise(none, found) is None


@pytest.mark.parametrize("frame", [0, FRAMES - 1])
def test_the_truth_is_read_only_of_frames_with_observations(frame: int) -> None:
    world = _World()
    tracks = world.tracks.select(world.tracks.frame == frame)
    read: list[int] = []

    def read_truth(index: int) -> FrameTruth:
        read.append(index)
        return world.read_truth(index)

    find_true_points(tracks, SONAR, world.sonar_from_world, read_truth)
    assert read == [frame]


def test_the_point_is_that_of_the_most_observations_and_not_of_a_compromise() -> None:
    """Three observations agree; one at 0.45 m and two at 0.9 m are closer to each other than to these."""
    world = _World()
    offset_m = np.tile([0.0, 0.0, 0.0, 0.45, 0.9, 0.9], POINTS)
    tracks = Tracks(world.tracks.track, world.tracks.frame, world.range_m + offset_m, world.bearing_rad)

    def read_truth(index: int) -> FrameTruth:
        truth = world.read_truth(index)
        return FrameTruth(np.nan_to_num(truth.elevation_rad), truth.clean)

    found = find_true_points(tracks, SONAR, world.sonar_from_world, read_truth)
    np.testing.assert_array_equal(found.inlier, offset_m == 0)
    np.testing.assert_allclose(found.xyz_m, world.xyz_m, atol=1e-9)


def test_an_observation_with_another_elevation_does_not_move_the_point() -> None:
    """Range and bearing agree; in one frame the pixel's strongest echo comes from 0.2 rad higher."""
    world = _World()

    def read_truth(index: int) -> FrameTruth:
        truth = world.read_truth(index)
        return FrameTruth(truth.elevation_rad + (0.2 if index == 2 else 0.0), truth.clean)

    found = find_true_points(world.tracks, SONAR, world.sonar_from_world, read_truth)
    assert found.known.all() and found.inlier.all()
    np.testing.assert_allclose(found.xyz_m, world.xyz_m, atol=1e-9)
