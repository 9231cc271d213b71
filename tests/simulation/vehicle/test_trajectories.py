"""Motion patterns of the sonar: smooth, with the target in view."""

import numpy as np
import pytest

from asfm.geometry.poses import invert, transform
from asfm.geometry.sonar import project
from asfm.simulation.vehicle.trajectories import MOTIONS, View

VIEW = View((1.0, 2.0, 0.5), 0.7, 0.4, 4.8)
TIMES_S = np.linspace(0.0, 16.0, 81)


@pytest.mark.parametrize("name", MOTIONS)
def test_motion_is_smooth_and_keeps_the_target_in_view(name: str) -> None:
    poses = MOTIONS[name](VIEW, TIMES_S, np.random.default_rng(1))
    steps_m = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    assert steps_m.max() < 0.2 and np.abs(np.diff(steps_m)).max() < 0.03
    assert np.abs(poses[:, :3, :3] @ np.swapaxes(poses[:, :3, :3], 1, 2) - np.eye(3)).max() < 1e-12
    range_m, bearing_rad, _ = project(transform(invert(poses), np.array(VIEW.target_m)))
    assert np.abs(bearing_rad).max() < np.deg2rad(50) and range_m.max() < 8
    span_m = np.ptp(poses[:, :3, 3], axis=0)
    if name == "static":
        assert np.array_equal(poses, np.tile(poses[0], (81, 1, 1)))
    elif name == "planar":
        assert span_m[2] < 1e-9 and span_m[:2].max() > 0.3
        assert np.ptp(poses[:, 2, 2]) < 1e-12  # neither roll nor pitch changes
    else:
        assert span_m.max() > 0.3 and np.ptp(poses[:, 2, 2]) > 1e-4


def test_orbit_turns_around_the_target_and_revisit_closes_a_loop() -> None:
    orbit = MOTIONS["orbit"](VIEW, TIMES_S, np.random.default_rng(1))
    turned_rad = np.arctan2(orbit[-1, 1, 0], orbit[-1, 0, 0]) - np.arctan2(orbit[0, 1, 0], orbit[0, 0, 0])
    assert turned_rad == pytest.approx(16 * 0.2 / 4.8, abs=0.15)
    places = MOTIONS["revisit"](VIEW, TIMES_S, np.random.default_rng(1))[:, :3, 3]
    from_start = np.linalg.norm(places - places[0], axis=1)
    assert from_start[30:50].min() > 0.6
    assert from_start[67:].min() < 0.35
