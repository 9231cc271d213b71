"""The noise of each track over the typical one, from its residuals."""

import numpy as np
import pytest

from asfm.backend.track_noise import NARROWEST, WIDEST, estimate_track_noise


def test_noisy_tracks_are_told_from_sharp_ones() -> None:
    rng = np.random.default_rng(0)
    true = np.repeat([1.0, 0.6, 2.0], [60, 20, 20])
    track = np.repeat(np.arange(100), 40)
    residual = rng.normal(size=(len(track), 2)) * true[track][:, None]
    found = estimate_track_noise(track, np.ones(len(track), dtype=bool), 0.3 * residual)  # only the comparison counts
    for value, margin in ((1.0, 0.05), (0.6, 0.07), (2.0, 0.15)):
        assert np.median(found[true == value]) == pytest.approx(value, abs=margin)


def test_short_tracks_stay_near_the_typical_one() -> None:
    rng = np.random.default_rng(1)
    track = np.repeat(np.arange(300), 3)
    found = estimate_track_noise(track, np.ones(len(track), dtype=bool), rng.normal(size=(len(track), 2)))
    assert found.std() < 0.2 and abs(np.median(found) - 1) < 0.2


def test_what_is_not_observed_does_not_count_and_nothing_goes_beyond_the_limits() -> None:
    track = np.repeat(np.arange(12), 20)
    residual = np.ones((len(track), 2))
    residual[track == 0], residual[track == 1] = 1e3, 1e-9
    residual[5] = 1e6
    observed = np.ones(len(track), dtype=bool)
    observed[5] = False
    observed[track == 2] = False
    found = estimate_track_noise(track, observed, residual)
    assert found[0] == WIDEST and found[1] == NARROWEST and found[2] == 1.0
    np.testing.assert_allclose(found[3:], 1.0, atol=0.05)


def test_perfect_or_no_observations_leave_every_track_as_it_is() -> None:
    track = np.repeat(np.arange(4), 5)
    nothing = np.zeros(0, dtype=np.int64)
    np.testing.assert_array_equal(estimate_track_noise(track, np.ones(20, dtype=bool), np.zeros((20, 2))), np.ones(4))
    assert estimate_track_noise(nothing, nothing.astype(bool), np.zeros((0, 2))).shape == (0,)
