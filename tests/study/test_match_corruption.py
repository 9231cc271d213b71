"""Controlled corruption: matches of the stated precision, recall, noise and track length."""

from dataclasses import replace

import numpy as np
import pytest

from asfm.geometry.sonar import SonarModel
from asfm.study.cell import Corruption
from asfm.study.match_corruption import CorruptedMatches, corrupt_matches, swap_partners
from asfm.study.true_tracks import TrueTracks
from asfm.types import FloatArray

SONAR = SonarModel.evenly_spaced("test", (1.0, 5.0), (-0.5, 0.5), (400, 100), 0.2)
CLEAN = Corruption(0.0, "random", 0.0, 0.0, "white", 1.0, None, 100)
FRAMES, POINTS, GAP = 12, 100, 4


def make_tracks() -> TrueTracks:
    rng = np.random.default_rng(3)
    track, frame = np.repeat(np.arange(POINTS), FRAMES), np.tile(np.arange(FRAMES), POINTS)
    range_m = np.repeat(rng.uniform(1.5, 4.5, POINTS), FRAMES) + 0.01 * frame
    return TrueTracks(track, frame, range_m, np.repeat(rng.uniform(-0.4, 0.4, POINTS), FRAMES))


def corrupt(corruption: Corruption, seed: int = 0) -> CorruptedMatches:
    return corrupt_matches(make_tracks(), SONAR, corruption, FRAMES, GAP, np.random.default_rng(seed))


def errors(found: CorruptedMatches) -> FloatArray:
    """Errors in bins and beams (POINTS, FRAMES, 2): keypoints are in the order of the tracks."""
    tracks = make_tracks()
    range_m = np.stack([frame.range_m for frame in found.external.keypoints], axis=1)
    bearing_rad = np.stack([frame.bearing_rad for frame in found.external.keypoints], axis=1)
    in_bins = (range_m - tracks.range_m.reshape(POINTS, FRAMES)) / SONAR.range_step_m
    in_beams = (bearing_rad - tracks.bearing_rad.reshape(POINTS, FRAMES)) / SONAR.bearing_step_rad
    return np.stack([in_bins, in_beams], axis=-1)


def test_clean_matches_are_all_true_and_exact() -> None:
    found = corrupt(CLEAN)
    assert found.precision == found.recall == 1
    assert {match.frame_b - match.frame_a for match in found.external.matches} == {1, 2, 3, 4}
    assert all(
        len(match) == POINTS and (match.index[:, 0] == match.index[:, 1]).all() for match in found.external.matches
    )
    np.testing.assert_allclose(errors(found), 0, atol=1e-9)
    keypoints = found.external.keypoints[3]
    np.testing.assert_allclose(SONAR.range_at_row(keypoints.row_column[:, 0]), keypoints.range_m)


@pytest.mark.parametrize("kind", ["random", "look-alike"])
@pytest.mark.parametrize("share", [0.05, 0.2, 0.4])
def test_a_share_of_the_matches_is_wrong(kind: str, share: float) -> None:
    found = corrupt(replace(CLEAN, wrong_share=share, wrong_kind=kind))
    assert found.precision == pytest.approx(1 - share, abs=0.01) and found.recall == pytest.approx(1 - share, abs=0.01)
    wrong = [(match.index[:, 0] != match.index[:, 1]).mean() for match in found.external.matches]
    assert np.mean(wrong) == pytest.approx(share, abs=0.01)
    for match in found.external.matches:
        assert len(np.unique(match.index[:, 1])) == len(match), "a partner is taken once"


def test_look_alikes_are_the_nearest_in_the_image() -> None:
    index = np.stack([np.arange(6), np.arange(6)], axis=1)
    place = np.array([[0, 0], [0, 1], [50, 0], [50, 1], [90, 0], [90, 1]], dtype=float)
    rng, dial = np.random.default_rng(0), replace(CLEAN, wrong_share=0.9)
    swapped = swap_partners(index, place, replace(dial, wrong_kind="look-alike"), rng)
    wrong = swapped[:, 0] != swapped[:, 1]
    assert wrong.sum() >= 4
    assert (np.linalg.norm(place[swapped[wrong, 1]] - place[swapped[wrong, 0]], axis=1) == 1).all()
    assert swap_partners(index[:1], place, dial, rng).tolist() == [[0, 0]]


@pytest.mark.parametrize("kind", ["white", "track"])
def test_noise_has_the_stated_size_and_lasts_as_stated(kind: str) -> None:
    found = errors(corrupt(replace(CLEAN, range_noise_bins=2.0, bearing_noise_beams=0.5, noise_kind=kind)))
    assert found.std(axis=(0, 1)) == pytest.approx([2.0, 0.5], rel=0.2)
    along = found.std(axis=1).mean(axis=0)
    assert along == (pytest.approx([0, 0], abs=1e-9) if kind == "track" else pytest.approx([2.0, 0.5], rel=0.15))


def test_a_share_of_the_true_matches_is_kept() -> None:
    found = corrupt(replace(CLEAN, recall=0.3))
    assert found.precision == 1 and found.recall == pytest.approx(0.3, abs=0.005)


def test_tracks_are_cut() -> None:
    found = corrupt(replace(CLEAN, track_length=3))
    for match in found.external.matches:
        within = match.frame_a // 3 == match.frame_b // 3
        assert len(match) == (POINTS if within else 0)
    assert found.precision == 1 and found.recall is not None and found.recall < 0.5


def test_the_generator_alone_decides() -> None:
    settings = replace(CLEAN, wrong_share=0.2, recall=0.5, range_noise_bins=1.0)
    one, same, other = (corrupt(settings, seed) for seed in (1, 1, 2))
    assert all(
        np.array_equal(a.index, b.index) for a, b in zip(one.external.matches, same.external.matches, strict=True)
    )
    assert not np.array_equal(one.external.keypoints[0].range_m, other.external.keypoints[0].range_m)
