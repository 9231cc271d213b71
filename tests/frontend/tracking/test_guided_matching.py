"""Guided matching on a scene with known tracks: gaps are filled, duplicates merged, and nothing wrong is added."""

from dataclasses import replace

import numpy as np
import pytest

from asfm.frontend.tracking.guided_matching import add_matches, match_to_landmarks
from asfm.frontend.tracking.track_builder import build_tracks
from asfm.frontend.tracking.triangulated_tracks import TriangulatedTracks, predict_observations
from asfm.geometry.poses import invert, transform
from asfm.geometry.sonar import back_project, project
from asfm.types import Matches, Tracks
from tests.frontend.tracking.guided_reference import match_plainly
from tests.frontend.tracking.landmark_scene import (
    ALL_AROUND,
    FRAMES,
    MIDDLE,
    POINTS,
    SONAR,
    LandmarkScene,
    make_scene,
    one_track_per_point,
    turn_astern,
    without_frame,
)
from tests.worlds import make_keypoints

WINDOW = 16


def chain(triangulated: TriangulatedTracks) -> list[Matches]:
    """Return matches that the tracks can be built from: each observation with the next."""
    tracks, found = triangulated.tracks, []
    for here in np.flatnonzero(np.diff(tracks.track) == 0):
        pair = np.array([[triangulated.keypoint[here], triangulated.keypoint[here + 1]]])
        found.append(Matches(int(tracks.frame[here]), int(tracks.frame[here + 1]), pair, np.zeros(1)))
    return found


def rebuild(triangulated: TriangulatedTracks, window: int = WINDOW) -> TriangulatedTracks:
    """Build tracks from the previous matches and the guided ones."""
    tracks = build_tracks(triangulated.keypoints, [*chain(triangulated), *match_to_landmarks(triangulated, window)], 2)
    return replace(triangulated, tracks=tracks, xyz_m=np.zeros((tracks.count, 3)))


def points_of_tracks(scene: LandmarkScene, triangulated: TriangulatedTracks) -> list[set[int]]:
    shown = [int(scene.order[f][k]) for f, k in zip(triangulated.tracks.frame, triangulated.keypoint, strict=True)]
    return [
        {shown[at] for at in np.flatnonzero(triangulated.tracks.track == track)}
        for track in range(triangulated.tracks.count)
    ]


@pytest.mark.parametrize("seed", range(3))
def test_missing_observations_are_added_to_their_tracks(seed: int) -> None:
    scene, label = make_scene(seed), one_track_per_point()
    label[np.random.default_rng(seed).random(label.shape) < 0.3] = -1
    before = scene.triangulate(label)
    after = rebuild(before)
    assert len(before.tracks) < 0.75 * FRAMES * POINTS
    assert len(after.tracks) > 0.93 * FRAMES * POINTS
    assert all(len(points) == 1 for points in points_of_tracks(scene, after))
    assert len(np.unique(np.stack([after.tracks.track, after.tracks.frame]), axis=1).T) == len(after.tracks)


@pytest.mark.parametrize("seed", range(3))
def test_two_halves_of_a_track_are_merged(seed: int) -> None:
    scene, label = make_scene(seed), one_track_per_point()
    label[FRAMES // 2 :] += POINTS
    before, after = scene.triangulate(label), rebuild(scene.triangulate(label))
    assert (before.tracks.count, after.tracks.count) == (2 * POINTS, POINTS)
    assert sorted(points_of_tracks(scene, after), key=min) == [{point} for point in range(POINTS)]
    assert len(after.tracks) == FRAMES * POINTS


def test_complete_tracks_stay_unchanged() -> None:
    triangulated = make_scene().triangulate(one_track_per_point())
    assert match_to_landmarks(triangulated, WINDOW) == []
    assert len(rebuild(triangulated).tracks) == len(triangulated.tracks)


def test_keypoints_far_from_their_prediction_are_not_matched() -> None:
    displaced = np.arange(POINTS) < 25
    scene = make_scene().displace(displaced)
    found = match_to_landmarks(scene.triangulate(without_frame(MIDDLE)), WINDOW)
    a, b = (np.concatenate(side) for side in zip(*(scene.points_of(match) for match in found), strict=True))
    np.testing.assert_array_equal(a, b)
    assert not displaced[a].any() and len(a) > 0.85 * np.sum(~displaced)


def test_keypoints_with_other_descriptors_are_not_matched() -> None:
    scene = make_scene()
    assert match_to_landmarks(scene.triangulate(without_frame(MIDDLE)), WINDOW)
    scene.keypoints[MIDDLE].descriptors[:] = np.random.default_rng(9).integers(0, 256, (POINTS, 61))
    assert match_to_landmarks(scene.triangulate(without_frame(MIDDLE)), WINDOW) == []


def test_points_at_two_elevations_are_not_merged_where_their_keypoints_coincide() -> None:
    """In the middle frame their pixels and descriptors are equal; the points, known from other frames, are apart."""
    scene = make_scene(noise=0.1)
    local = np.array([back_project(np.array(5.0), np.array(0.1), elevation) for elevation in (0.08, -0.08)])
    pair = transform(scene.world_from_sonar[MIDDLE], local)
    keypoints = []
    for number, (frame, shown) in enumerate(zip(scene.keypoints, scene.order, strict=True)):
        range_m, bearing_rad = frame.range_m.copy(), frame.bearing_rad.copy()
        seen = project(transform(invert(scene.world_from_sonar[number]), pair))
        for point in (0, 1):
            at = int(np.flatnonzero(shown == point)[0])
            range_m[at], bearing_rad[at] = seen[0][point], seen[1][point]
        keypoints.append(make_keypoints(range_m, bearing_rad, frame.descriptors.copy(), sonar=SONAR))
        keypoints[-1].descriptors[shown == 1] = keypoints[-1].descriptors[shown == 0]
    label = one_track_per_point()
    label[MIDDLE:, 0], label[:MIDDLE, 1] = -1, -1  # point 0 is observed before that frame, point 1 from it on
    apart = replace(scene, keypoints=keypoints, xyz_m=np.concatenate([pair, scene.xyz_m[2:]]))
    triangulated = apart.triangulate(label)
    assert predict_observations(triangulated, MIDDLE, WINDOW).track.tolist() == [0]
    pairs = np.concatenate(
        [np.stack(apart.points_of(match), axis=1) for match in match_to_landmarks(triangulated, WINDOW)]
    )
    assert [0, 0] in pairs.tolist() and [1, 1] in pairs.tolist()
    assert not {(0, 1), (1, 0)} & {(int(one), int(other)) for one, other in pairs}


def test_tracks_are_extended_up_to_the_window() -> None:
    label = one_track_per_point()
    label[3:] = -1
    scene = make_scene()
    for window in (0, 2, 5):
        found = match_to_landmarks(scene.triangulate(label), window)
        assert {match.frame_b for match in found} == set(range(3, min(3 + window, FRAMES)))
        assert all(match.frame_b - match.frame_a <= window for match in found)


def test_known_matches_are_not_added_again() -> None:
    found = match_to_landmarks(make_scene().triangulate(without_frame(4)), WINDOW)
    once = add_matches([], found)
    count = sum(len(match) for match in once)
    assert 0.85 * POINTS < count <= POINTS
    assert add_matches(once, found) == once
    part = [replace(match, index=match.index[1:], cost=match.cost[1:]) for match in found]
    assert sum(len(match) for match in add_matches(part, found)) == count


def test_no_tracks_points_or_keypoints_give_no_matches() -> None:
    scene = make_scene()
    triangulated = scene.triangulate(one_track_per_point())
    none = np.zeros(0, dtype=np.int64)
    nothing = Tracks(none, none, np.zeros(0), np.zeros(0), keypoint=none)
    assert (
        match_to_landmarks(
            replace(triangulated, tracks=nothing, xyz_m=np.zeros((0, 3)), has_point=np.zeros(0, dtype=bool)), WINDOW
        )
        == []
    )
    label = without_frame(4)
    unknown = np.zeros(POINTS, dtype=bool)
    assert match_to_landmarks(replace(scene.triangulate(label), has_point=unknown), WINDOW) == []
    empty = make_keypoints(np.zeros(0), np.zeros(0))
    keypoints = [empty if number == 4 else frame for number, frame in enumerate(scene.keypoints)]
    assert match_to_landmarks(replace(scene.triangulate(label), keypoints=keypoints), WINDOW) == []


def test_stated_sigmas_are_those_of_the_new_keypoint() -> None:
    triangulated = make_scene().triangulate(without_frame(4))
    stated = replace(triangulated.tracks, sigma=np.tile([0.05, 0.02], (len(triangulated.tracks), 1)))
    found = match_to_landmarks(replace(triangulated, tracks=stated), WINDOW)
    assert found and match_to_landmarks(triangulated, WINDOW)[0].sigma is None
    for match in found:
        assert match.sigma is not None
        np.testing.assert_allclose(match.sigma, np.tile(triangulated.default_sigma, (len(match), 1)))


def test_landmarks_behind_the_sonar_are_matched_like_those_ahead_of_it() -> None:
    """Bearings jump from pi to -pi astern."""
    ahead = replace(make_scene(noise=1.0).triangulate(without_frame(MIDDLE)), sonar=ALL_AROUND)
    found, expected = match_to_landmarks(turn_astern(ahead), WINDOW), match_to_landmarks(ahead, WINDOW)
    assert [match.index.tolist() for match in found] == [match.index.tolist() for match in expected]
    assert sum(len(match) for match in found) > 0.8 * POINTS


@pytest.mark.parametrize(("seed", "stated"), [(0, False), (1, True)])
def test_matches_and_costs_are_those_of_a_plain_search(seed: int, stated: bool) -> None:
    """Tracks with gaps, in two halves, with points off the truth or without any, and keypoints beside each other."""
    rng, label = np.random.default_rng(seed), one_track_per_point()
    label[FRAMES // 2 :] += POINTS
    label[rng.random(label.shape) < 0.4] = -1
    triangulated = make_scene(seed, noise=1.5).triangulate(label)
    tracks = triangulated.tracks
    if stated:
        sigma = triangulated.default_sigma * rng.uniform(0.3, 3.0, (len(tracks), 2))
        triangulated = replace(triangulated, tracks=replace(tracks, sigma=sigma))
    xyz_m = triangulated.xyz_m + rng.normal(0, 0.03, (tracks.count, 3))
    triangulated = replace(triangulated, xyz_m=xyz_m, has_point=rng.random(tracks.count) < 0.8)
    found = {
        (match.frame_a, a, match.frame_b, b): cost
        for match in match_to_landmarks(triangulated, WINDOW)
        for (a, b), cost in zip(match.index.tolist(), match.cost.tolist(), strict=True)
    }
    expected = match_plainly(triangulated, WINDOW)
    assert len(expected) > 50 and set(found) == set(expected)
    np.testing.assert_allclose([found[key] for key in expected], list(expected.values()), rtol=1e-6)
