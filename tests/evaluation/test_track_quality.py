"""Length and purity of tracks over planted points."""

import numpy as np
import pytest

from asfm.evaluation.track_quality import measure_tracks
from asfm.geometry.poses import invert
from asfm.types import FrameTruth, Tracks
from tests.evaluation.test_true_points import FRAMES, POINTS, SONAR, _World


def test_tracks_of_planted_points_are_pure() -> None:
    world = _World()
    found = measure_tracks(world.tracks, SONAR, invert(world.sonar_from_world), world.read_truth)
    assert (found.tracks, found.mean_length, found.median_length, found.purity) == (POINTS, FRAMES, FRAMES, 1.0)


def test_foreign_observations_lower_the_purity_by_their_share() -> None:
    world = _World()
    range_m = world.range_m.copy()
    range_m[[1, 2, FRAMES + 4]] += 0.5
    wrong = Tracks(world.tracks.track, world.tracks.frame, range_m, world.bearing_rad)
    found = measure_tracks(wrong, SONAR, invert(world.sonar_from_world), world.read_truth)
    assert found.purity == pytest.approx(1 - 3 / FRAMES / POINTS)


def test_every_track_counts_the_same_and_lengths_need_no_truth() -> None:
    world = _World()
    kept = (world.tracks.track > 0) | (world.tracks.frame < 3)
    range_m = world.range_m + 0.5 * ((world.tracks.track == 0) & (world.tracks.frame == 2))
    tracks = Tracks(world.tracks.track, world.tracks.frame, range_m, world.bearing_rad).select(kept)
    found = measure_tracks(tracks, SONAR, invert(world.sonar_from_world), world.read_truth)
    assert found.purity == pytest.approx(1 - 1 / 3 / POINTS)
    assert found.median_length == FRAMES and found.mean_length == pytest.approx(FRAMES - 3 / POINTS)
    assert measure_tracks(tracks, SONAR).purity is None
    assert measure_tracks(tracks, SONAR).mean_length == found.mean_length


def test_tracks_on_noise_have_purity_zero_and_no_tracks_none() -> None:
    world = _World()
    silent = FrameTruth(np.full(SONAR.shape, np.nan), np.zeros(SONAR.shape, np.float32))
    assert measure_tracks(world.tracks, SONAR, invert(world.sonar_from_world), lambda index: silent).purity == 0.0
    none = world.tracks.select(np.zeros(len(world.tracks), dtype=bool))
    found = measure_tracks(none, SONAR, invert(world.sonar_from_world), world.read_truth)
    assert (found.tracks, found.mean_length, found.purity) == (0, None, None)
