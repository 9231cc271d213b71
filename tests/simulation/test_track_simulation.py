"""Simulated tracks of points on a rough floor."""

import numpy as np
import pytest

from asfm.geometry.poses import invert, transform
from asfm.geometry.sonar import project
from asfm.simulation.track_simulation import SONAR, simulate_tracks


def test_observations_are_projections_of_the_points_with_the_stated_noise() -> None:
    floor = simulate_tracks(12, 20, (6, 12), "sway", 1.0, navigation=True)
    assert floor.sequence.groundtruth is not None and floor.tracks.sigma is not None
    truth, tracks, sigma = floor.sequence.groundtruth.world_from_vehicle, floor.tracks, floor.tracks.sigma
    in_sonar_m = transform(invert(truth)[tracks.frame], floor.xyz_m[tracks.track])
    assert SONAR.sees(in_sonar_m).all()
    range_m, bearing_rad, _ = project(in_sonar_m)
    error = np.stack([tracks.range_m - range_m, tracks.bearing_rad - bearing_rad], axis=1) / sigma
    np.testing.assert_allclose(error.std(axis=0), 1, atol=0.2)
    np.testing.assert_allclose(sigma[0], [1.5 * SONAR.range_step_m, np.deg2rad(0.3)], rtol=0.1)
    views = np.bincount(tracks.track)
    assert views.min() >= 6 and len(floor.xyz_m) == tracks.count == len(views)
    assert len(tracks) / 12 == pytest.approx(20, rel=0.1)
    assert (np.diff(tracks.track * 12 + tracks.frame) > 0).all(), "sorted by track and frame"
    assert abs(floor.xyz_m[:, 2]).max() < 1 < np.ptp(floor.xyz_m[:, :2], axis=0).min()
