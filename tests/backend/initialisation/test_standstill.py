"""Standstill: found exactly where features stay, whatever swims by, and nowhere else."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from asfm.backend.initialisation.standstill import (
    HELD_SHARE,
    WINDOW_STEPS,
    diagnose_standstill,
    find_standstill,
    standstill_sigma,
)
from asfm.types import FloatArray, Tracks

SIGMA = np.array([0.01, 0.002])


def make_tracks(
    moved: NDArray[np.floating[Any]], count: int = 40, noise: float = 0.5, swimming: float = 0.0, seed: int = 0
) -> tuple[Tracks, FloatArray]:
    """Make tracks of features that all move by (N,) sigmas, seen in every frame; a share of them swims on its own."""
    rng, frames = np.random.default_rng(seed), len(moved)
    position = np.stack([rng.uniform(3, 6, count), rng.uniform(-0.5, 0.5, count)], axis=1)[:, None] + np.zeros(
        (count, frames, 2)
    )
    position += moved[None, :, None] * SIGMA
    alone = np.arange(count) < swimming * count
    position[alone] += 3 * np.arange(frames)[None, :, None] * SIGMA
    position += noise * rng.normal(size=position.shape) * SIGMA
    track, frame = np.divmod(np.arange(count * frames), frames)
    range_m, bearing_rad = position.reshape(-1, 2).T
    return Tracks(track, frame, range_m, bearing_rad), np.tile(SIGMA, (len(track), 1))


def find(moved: NDArray[np.floating[Any]], **options: float) -> list[int]:
    tracks, sigma = make_tracks(moved, **options)  # type: ignore[arg-type]
    return np.flatnonzero(find_standstill(tracks, len(moved), sigma)).tolist()


@pytest.mark.parametrize("swimming", [0.0, 0.3])
@pytest.mark.parametrize("seed", range(3))
def test_a_standing_sonar_is_found_though_something_swims_by(swimming: float, seed: int) -> None:
    assert find(np.zeros(40), swimming=swimming, seed=seed) == list(range(39))


@pytest.mark.parametrize("speed", [0.5, 3.0, 20.0])
def test_a_moving_sonar_never_stands(speed: float) -> None:
    assert find(speed * np.arange(80, dtype=float)) == []


def test_the_wait_before_between_and_after_motions_is_found_to_the_step() -> None:
    speed = np.concatenate([np.zeros(30), np.full(10, 8.0), np.zeros(25), np.full(10, 8.0), np.zeros(20)])
    moved = np.concatenate([[0.0], np.cumsum(speed)])
    assert find(moved) == np.flatnonzero(speed == 0).tolist()


def test_a_drift_too_slow_for_a_window_is_no_standstill() -> None:
    slow = 0.02 * np.arange(200, dtype=float)
    assert find(slow[: WINDOW_STEPS + 1]) == list(range(WINDOW_STEPS)), "a window alone cannot tell"
    assert find(slow) == []


def test_a_pause_shorter_than_a_window_is_not_looked_at() -> None:
    assert find(np.zeros(WINDOW_STEPS)) == []
    assert find(np.zeros(WINDOW_STEPS + 1)) == list(range(WINDOW_STEPS))


@pytest.mark.parametrize("options", [{"count": 8}, {"noise": 3.0}])
def test_few_features_or_too_much_noise_tell_nothing(options: dict[str, float]) -> None:
    assert find(np.zeros(40), **options) == []


def test_no_observations_and_single_frames_have_no_standstill() -> None:
    empty = np.zeros(0, dtype=np.int64)
    none = Tracks(empty, empty, np.zeros(0), np.zeros(0))
    assert find_standstill(none, 30, np.zeros((0, 2))).tolist() == [False] * 29
    assert len(find_standstill(none, 1, np.zeros((0, 2)))) == 0


def test_differences_count_in_each_axis() -> None:
    """A sonar that only turns changes bearings, one that only advances ranges."""
    for axis in range(2):
        tracks, sigma = make_tracks(np.zeros(40))
        moving = 5 * SIGMA[axis] * tracks.frame
        tracks = Tracks(
            tracks.track,
            tracks.frame,
            tracks.range_m + moving * (axis == 0),
            tracks.bearing_rad + moving * (axis == 1),
        )
        assert not find_standstill(tracks, 40, sigma).any()


def test_the_prior_of_a_standstill_is_a_share_of_a_features_sigma() -> None:
    np.testing.assert_allclose(standstill_sigma(np.tile(SIGMA, (9, 1))), HELD_SHARE * SIGMA[::-1])


def test_the_diagnostic_says_how_much_motion_would_be_seen() -> None:
    found = diagnose_standstill(np.tile([0.0152, np.deg2rad(0.12)], (9, 1)))
    assert found.code == "no-motion-seen" and "0.015 m" in found.message and "0.12 degrees" in found.message
