"""Overlays: pixels of the polar grid, and segments of tracks."""

import numpy as np

from asfm.geometry.sonar import SonarModel
from asfm.types import Tracks
from asfm.visualization.overlays import PolarGrid, build_track_segments

UNEVEN = SonarModel("uneven", np.linspace(1.0, 5.0, 40), 0.5 * np.linspace(-1, 1, 31) ** 3, 0.3)


def test_polar_grid_returns_pixel_centres() -> None:
    grid = PolarGrid(UNEVEN)
    xy_px = grid.pixel_at(UNEVEN.range_m[[3, 17]], UNEVEN.bearing_rad[[20, 5]])
    np.testing.assert_allclose(xy_px, [[20.5, 3.5], [5.5, 17.5]])
    image = np.zeros(UNEVEN.shape)
    assert grid.draw(image) is image


def test_segments_never_join_two_tracks() -> None:
    track = np.array([0, 0, 0, 1, 2, 2])
    xy_px = np.random.default_rng(0).uniform(0, 100, (6, 2))
    steps = build_track_segments(Tracks(track, np.array([0, 1, 4, 2, 0, 1]), np.ones(6), np.zeros(6)), xy_px)
    np.testing.assert_array_equal(steps[:, 1], xy_px)
    np.testing.assert_array_equal(steps[:, 0], xy_px[[0, 0, 1, 3, 4, 4]])
    nothing = np.zeros(0, int)
    assert build_track_segments(Tracks(nothing, nothing, np.zeros(0), np.zeros(0)), np.zeros((0, 2))).shape == (0, 2, 2)
