"""What is drawn of a run: geometry that agrees with the sonar's own, colours that tell things apart."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from asfm.geometry.poses import make_pose, transform
from asfm.geometry.sonar import SonarModel, project
from asfm.sequence import Sequence
from asfm.types import FloatArray, Frame, Landmarks, Reconstruction, Tracks, Trajectory
from asfm.visualization.drawing import (
    SHEET_SHAPE,
    PolarGrid,
    anchor_lines,
    anchor_trajectory,
    brighten_image,
    choose_hues,
    choose_view,
    colour_heights,
    draw_whiskers,
    encode_picture,
    measure_drift,
    name_points,
    outline_frustum,
    pair_steps,
    shrink,
    split_by_frame,
    summarise_run,
    tessellate_sheet,
    tint_mask,
)

SONAR = SonarModel.evenly_spaced("toy", (0.5, 8.0), (-0.6, 0.5), (150, 110), 0.2)
UNEVEN = SonarModel("uneven", np.linspace(1.0, 5.0, 40), 0.5 * np.linspace(-1, 1, 31) ** 3, 0.3)


def _path(count: int, step_m: float = 0.3) -> FloatArray:
    turn = 0.1 * np.arange(count)
    xyz_m = np.stack([turn * step_m * 10, np.sin(turn), 0.2 * turn], axis=-1)
    return make_pose(xyz_m, Rotation.from_euler("zyx", np.stack([turn, 0.3 + 0 * turn, 0.1 * turn], axis=-1)))


@pytest.mark.parametrize("sonar", [SONAR, UNEVEN], ids=lambda sonar: str(sonar.name))
def test_frustum_runs_along_the_edges_of_what_the_sonar_sees(sonar: SonarModel) -> None:
    """Every point lies on at least two of the six faces; a hair inwards it is seen, a hair outwards it is not."""
    corners_m = np.concatenate(outline_frustum(sonar))
    range_m, bearing_rad, elevation_rad = project(corners_m)
    half = sonar.elevation_aperture_rad / 2
    faces = [
        np.isclose(value[:, None], ends).any(axis=1)
        for value, ends in [
            (range_m, sonar.range_edges_m[[0, -1]]),
            (bearing_rad, sonar.bearing_edges_rad[[0, -1]]),
            (elevation_rad, np.array([-half, half])),
        ]
    ]
    assert (np.sum(faces, axis=0) >= 2).all()
    middle_m = np.array([sonar.range_m.mean(), 0.0, 0.0])
    assert sonar.sees(corners_m + 1e-3 * (middle_m - corners_m)).mean() > 0.9
    assert not sonar.sees(corners_m - 1e-3 * (middle_m - corners_m)).any()


@pytest.mark.parametrize("sonar", [SONAR, UNEVEN], ids=lambda sonar: str(sonar.name))
def test_sheet_covers_the_surface_of_zero_elevation_once(sonar: SonarModel) -> None:
    sheet = tessellate_sheet(sonar)
    xyz_m, triangles = sheet["vertex_positions"], sheet["triangle_indices"]
    assert (xyz_m[:, 2] == 0).all()
    a, b, c = xyz_m[triangles].transpose(1, 0, 2)
    area_m2 = 0.5 * np.cross(b - a, c - a)[:, 2]
    assert (area_m2 > 0).all() or (area_m2 < 0).all()
    near_m, far_m = sonar.range_edges_m[[0, -1]]
    expected_m2 = 0.5 * np.ptp(sonar.bearing_edges_rad) * (far_m**2 - near_m**2)
    assert np.abs(area_m2).sum() == pytest.approx(expected_m2, rel=2e-3)


@pytest.mark.parametrize("sonar", [SONAR, UNEVEN], ids=lambda sonar: str(sonar.name))
def test_sheet_shows_each_pixel_where_it_was_seen(sonar: SonarModel) -> None:
    sheet = tessellate_sheet(sonar)
    range_m, bearing_rad, _ = project(sheet["vertex_positions"])
    pixel = np.stack([sonar.column_at_bearing(bearing_rad), sonar.row_at_range(range_m)], axis=-1)
    np.testing.assert_allclose(pixel / sonar.shape[::-1], sheet["vertex_texcoords"], atol=1e-6)


def test_shrunk_picture_is_grey_and_keeps_its_brightness() -> None:
    rng = np.random.default_rng(0)
    picture = (rng.uniform(0, 60, (512, 256)) + np.linspace(0, 190, 256)).astype(np.uint8)
    small = np.frombuffer(shrink(picture), np.uint8).reshape(*SHEET_SHAPE, 3)
    assert (small == small[..., :1]).all()
    blocks = picture.reshape(SHEET_SHAPE[0], 4, SHEET_SHAPE[1], 4).mean(axis=(1, 3))
    np.testing.assert_allclose(small[..., 0], blocks, atol=0.51)


@given(seed=st.integers(0, 99), late_s=st.floats(0.0, 1.5))
@settings(max_examples=20, deadline=None)
def test_anchored_trajectory_keeps_its_shape_and_starts_on_the_estimate(seed: int, late_s: float) -> None:
    rng = np.random.default_rng(seed)
    stamps_s = np.linspace(0.0, 4.0, 17)
    estimate = Trajectory(stamps_s, _path(17))
    elsewhere = make_pose(rng.normal(size=3), Rotation.from_rotvec(rng.normal(size=3)))
    other_s = np.linspace(late_s, 3.1, 200)
    other = Trajectory(other_s, elsewhere @ _path(200, 0.1))
    anchored = anchor_trajectory(other, estimate)
    covered = (stamps_s >= late_s) & (stamps_s <= 3.1)
    np.testing.assert_array_equal(anchored.timestamps_s, stamps_s[covered])
    np.testing.assert_allclose(anchored.world_from_vehicle[0], estimate.world_from_vehicle[covered][0], atol=1e-9)
    moved = anchor_trajectory(replace(other, world_from_vehicle=elsewhere @ other.world_from_vehicle), estimate)
    np.testing.assert_allclose(moved.world_from_vehicle, anchored.world_from_vehicle, atol=1e-9)


def test_trajectory_of_another_time_has_nothing_to_anchor() -> None:
    estimate = Trajectory(np.arange(5.0), _path(5))
    assert anchor_trajectory(Trajectory(np.arange(5.0) + 100, _path(5)), estimate).world_from_vehicle.shape == (0, 4, 4)


def test_drift_is_the_distance_from_a_truth_that_begins_alike() -> None:
    """An odometer that reads a tenth too much, seen from another world; the truth begins late, at another rate."""
    stamps_s, truth_s = np.linspace(0.0, 4.0, 9), np.linspace(0.7, 4.0, 50)
    straight = np.array([3.0, 0.0, 4.0])
    walked = make_pose(1.1 * stamps_s[:, None] * straight, Rotation.identity(9))
    elsewhere = make_pose(np.array([1.0, 2.0, 3.0]), Rotation.from_rotvec([0.3, -0.2, 2.0]))
    truth = elsewhere @ make_pose(truth_s[:, None] * straight, Rotation.identity(50))
    at_s, drift_m = measure_drift(Trajectory(stamps_s, walked), Trajectory(truth_s, truth))
    np.testing.assert_allclose(at_s, stamps_s[2:])
    np.testing.assert_allclose(drift_m, 0.5 * (stamps_s[2:] - 1.0), atol=1e-9)


def test_only_lines_that_there_are_are_drawn() -> None:
    estimate, past = Trajectory(np.arange(5.0), _path(5)), Trajectory(np.arange(5.0) - 100, _path(5))
    sequence = _run(0, 0)[0]
    assert set(anchor_lines(sequence, estimate)) == {"estimate"}
    assert set(anchor_lines(replace(sequence, odometry=estimate, groundtruth=past), estimate)) == {
        "estimate",
        "odometry",
    }


def _angles(eye_m: FloatArray, target_m: FloatArray, xyz_m: FloatArray) -> FloatArray:
    """Degrees to the side of and above the line of sight, of a level eye: (N, 2)."""
    sight = target_m - eye_m
    level = Rotation.from_euler("ZY", [np.arctan2(sight[1], sight[0]), -np.arctan2(sight[2], np.hypot(*sight[:2]))])
    ahead, left, up = np.moveaxis(level.inv().apply(xyz_m - eye_m), -1, 0)
    return np.asarray(np.rad2deg(np.abs(np.arctan2([left, up], ahead))).T)


@given(heading_rad=st.floats(-3.1, 3.1), pitch_rad=st.floats(-1.5, np.pi / 2), seed=st.integers(0, 20))
@settings(max_examples=60, deadline=None)
def test_eye_has_the_scene_in_view_from_above(heading_rad: float, pitch_rad: float, seed: int) -> None:
    """Wherever the sonar looks; an eye exactly above would not know which way is up."""
    rng = np.random.default_rng(seed)
    attitude = Rotation.from_euler("ZYX", [[heading_rad, pitch_rad, 0.0]] * 9)
    poses = make_pose(rng.normal(size=3) * 30 + rng.normal(size=(9, 3)) * 0.3, attitude)
    seen_m = transform(poses[rng.integers(0, 9, 300)], rng.uniform([2, -2, -1], [7, 2, 1], (300, 3)))
    seen_m[0] += 1000  # one wild point must not drive the eye away
    outlook = choose_view(SONAR, poses, seen_m)
    offset_m = outlook.eye_m - outlook.target_m
    distance_m = np.linalg.norm(offset_m)
    assert np.hypot(*offset_m[:2]) > 0.3 * distance_m and offset_m[2] > 0.3 * distance_m
    inside = np.all(_angles(outlook.eye_m, outlook.target_m, seen_m) < np.array([41.0, 25.0]), axis=1)
    assert inside.mean() > 0.93 and not inside[0]
    assert distance_m < 4 * np.ptp(np.concatenate([poses[:, :3, 3], seen_m[1:]]), axis=0).max()
    assert (_angles(outlook.eye_m, outlook.target_m, poses[:, :3, 3]) < np.array([41.0, 25.0])).all()
    heights_m = np.concatenate([poses[:, 2, 3], seen_m[1:, 2]])
    assert heights_m.min() <= outlook.floor_m <= np.quantile(heights_m, 0.05)


def test_pictures_are_brightened_and_survive_their_encoding() -> None:
    image = np.tile(np.linspace(0, 1, 110, dtype=np.float32), (150, 1))
    invalid = np.zeros(SONAR.shape, bool)
    invalid[:20] = True
    picture = brighten_image(Frame(0, 0.0, image, invalid))
    assert picture.dtype == np.uint8 and picture.max() == 255 and (picture[:20] == 0).all()
    np.testing.assert_allclose((picture[20:] / 255.0) ** 2, image[20:], atol=2 / 255)
    for kind, tolerance in [("png", 0), ("jpeg", 12)]:
        data = np.frombuffer(encode_picture(kind, picture), np.uint8)
        decoded = np.asarray(cv2.imdecode(data, cv2.IMREAD_UNCHANGED), dtype=int)
        assert np.abs(decoded[30:] - picture[30:]).max() <= tolerance


def test_polar_grid_puts_pixels_where_the_image_has_them() -> None:
    grid = PolarGrid(UNEVEN)
    xy_px = grid.pixel_at(UNEVEN.range_m[[3, 17]], UNEVEN.bearing_rad[[20, 5]])
    np.testing.assert_allclose(xy_px, [[20.5, 3.5], [5.5, 17.5]])
    image = np.zeros(UNEVEN.shape)
    assert grid.draw(image) is image


def test_mask_is_outlined() -> None:
    mask = np.zeros((40, 30), bool)
    mask[5:15, 4:20] = True
    mask[0, 0] = True
    opacity = tint_mask(mask)[..., 3]
    assert (opacity[~mask] == 0).all()
    assert (opacity[6:14, 5:19] == 30).all() and (opacity[5, 4:20] == 200).all() and opacity[0, 0] == 200
    assert ((opacity == 200).sum(), (opacity == 30).sum()) == (2 * 10 + 2 * 14 + 1, 8 * 14)


def test_steps_never_join_two_tracks() -> None:
    track = np.array([0, 0, 0, 1, 2, 2])
    xy_px = np.random.default_rng(0).uniform(0, 100, (6, 2))
    steps = pair_steps(Tracks(track, np.array([0, 1, 4, 2, 0, 1]), np.ones(6), np.zeros(6)), xy_px)
    np.testing.assert_array_equal(steps[:, 1], xy_px)
    np.testing.assert_array_equal(steps[:, 0], xy_px[[0, 0, 1, 3, 4, 4]])
    nothing = np.zeros(0, int)
    assert pair_steps(Tracks(nothing, nothing, np.zeros(0), np.zeros(0)), np.zeros((0, 2))).shape == (0, 2, 2)


def test_observations_are_split_by_frame() -> None:
    tracks = Tracks(np.array([0, 0, 1, 1, 2]), np.array([0, 3, 1, 3, 3]), np.ones(5), np.zeros(5))
    split = split_by_frame(tracks, 6)
    assert [part.tolist() for part in split] == [[0], [2], [], [1, 3, 4], [], []]
    nothing = np.zeros(0, int)
    assert [len(part) for part in split_by_frame(Tracks(nothing, nothing, np.ones(0), np.ones(0)), 2)] == [0, 0]


def test_neighbouring_numbers_have_distant_hues() -> None:
    hues = choose_hues(np.arange(200)).astype(int)
    for step in (1, 2, 3):
        assert np.linalg.norm(hues[step:] - hues[:-step], axis=1).min() > 60


def test_heights_rise_from_blue_to_red_whatever_a_wild_one_does() -> None:
    count = 301
    z_m = np.append(np.linspace(-2, 1, 200), np.append(1e4, np.linspace(-90, 90, 100)))
    landmarks = replace(_run(count, 201)[1].landmarks, xyz_m=z_m[:, None] * [0, 0, 1])
    colours = colour_heights(landmarks).astype(int)
    assert colours[20, 2] > 2 * colours[20, 0] and colours[180, 0] > 2 * colours[180, 2]
    assert len(np.unique(colours[:200], axis=0)) > 100
    assert len(np.unique(colour_heights(_run(5, 5)[1].landmarks), axis=0)) == 1
    assert [len(colour_heights(_run(found, 0)[1].landmarks)) for found in (4, 0)] == [4, 0]


def test_whiskers_run_along_the_direction_known_least() -> None:
    landmarks = _run(3, 2)[1].landmarks
    turn = Rotation.from_rotvec([0.4, -0.2, 1.0])
    covariance_m2 = turn.as_matrix() @ np.diag([0.01, 0.09, 0.0004]) @ turn.as_matrix().T
    landmarks = replace(landmarks, xyz_m=np.arange(9.0).reshape(3, 3), covariance_m2=np.tile(covariance_m2, (3, 1, 1)))
    ends_m = draw_whiskers(landmarks, landmarks.well_constrained)
    np.testing.assert_allclose(ends_m.mean(axis=1), landmarks.xyz_m[:2])
    along = turn.inv().apply(ends_m[:, 1] - ends_m[:, 0])
    np.testing.assert_allclose(np.abs(along), [[0, 4 * 0.3, 0]] * 2, atol=1e-9)


def _run(count: int, good: int) -> tuple[Sequence, Reconstruction]:
    poses = make_pose(np.arange(3.0)[:, None] * [0.25, 0, 0], Rotation.identity(3))
    trajectory = Trajectory(np.arange(3.0), poses)
    track = np.arange(count)
    landmarks = Landmarks(
        track,
        np.zeros((count, 3)),
        np.zeros((count, 3, 3)),
        np.where(track < good, 0.02, 5.0),
        np.full(count, 3),
        track < good,
        np.zeros((count, 15, 3)),
    )
    tracks = Tracks(track, track, np.ones(count), np.zeros(count))

    def unread(index: int) -> Frame:
        raise AssertionError("the summary reads no frame")

    reconstruction = Reconstruction(trajectory, tracks, np.ones(count, bool), landmarks, np.zeros((0, 6, 6)), ())
    return Sequence("toy", SONAR, np.arange(3.0), unread), reconstruction


@pytest.mark.parametrize(("count", "good"), [(7, 4), (5, 0), (0, 0)])
def test_summary_states_the_counts(count: int, good: int) -> None:
    text = summarise_run(*_run(count, good))
    for words in ("toy", "3 frames", "0.50 m", f"{count} tracks", f"{count} landmarks", f"{good} well constrained"):
        assert words in text
    assert ("0.020 m" in text) == (good > 0) and "nan" not in text


def test_summary_lists_each_warning_on_a_line() -> None:
    sequence, reconstruction = _run(3, 2)
    assert "No warnings." in summarise_run(sequence, reconstruction)
    text = summarise_run(
        replace(sequence, warnings=("first.",)), replace(reconstruction, warnings=("second,\nin two lines.",))
    )
    assert "- **Warning:** first.\n- **Warning:** second, in two lines.\n" in text and "No warnings." not in text


def test_points_tell_their_sigma() -> None:
    landmarks = _run(3, 2)[1].landmarks
    named = name_points(landmarks, landmarks.well_constrained)
    assert named == ["track 0: 3 views, sigma 0.020 m", "track 1: 3 views, sigma 0.020 m"]
