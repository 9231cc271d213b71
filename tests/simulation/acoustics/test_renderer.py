"""Rendered images: objects at their range, bearing and elevation, shadows, layover and orientation."""

import numpy as np
import pytest
import trimesh

from asfm.errors import AsfmError
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import back_project, project
from asfm.simulation.acoustics.accumulation import average_elevation
from asfm.simulation.acoustics.rays import RayCaster
from asfm.simulation.acoustics.renderer import Renderer, make_renderer
from asfm.simulation.scenes.scene import Scene, join_scenes
from asfm.simulation.sonars.parameters import ImagingSonar
from asfm.simulation.sonars.presets import PRESETS
from asfm.types import FloatArray, ImageArray

EYE = np.eye(4)
SONAR = ImagingSonar(
    range_min=0.5, range_max=6.0, range_bins=440, azimuth=70, azimuth_bins=128, elevation=16, elevation_bins=420
)


def _ball(centre_m: FloatArray, radius_m: float, subdivisions: int = 4) -> Scene:
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius_m)
    return Scene("ball", mesh.vertices + centre_m, np.asarray(mesh.faces), np.ones(len(mesh.faces)))


def _render(scene: Scene, pose: FloatArray, sonar: ImagingSonar = SONAR) -> tuple[Renderer, ImageArray, FloatArray]:
    renderer = make_renderer(scene, sonar.model_copy(update={"gain": 1.0}), pose[None])
    echoes = renderer.trace(renderer.cast(pose))
    return renderer, np.sqrt(renderer.compute_power(echoes)), average_elevation(echoes, renderer.model.shape)


@pytest.mark.parametrize("case", range(12))
def test_small_ball_is_brightest_at_its_nearest_point(case: int) -> None:
    rng = np.random.default_rng(case)
    from scipy.spatial.transform import Rotation

    pose = make_pose(rng.normal(size=3), Rotation.random(rng=rng))
    radius_m = 0.04
    range_m = rng.uniform(0.7, 5.8)
    bearing_rad, elevation_rad = np.deg2rad(rng.uniform([-34, -7.6], [34, 7.6]))
    centre_m = back_project(np.array(range_m + radius_m), np.array(bearing_rad), elevation_rad)
    renderer, amplitude, elevation = _render(_ball(transform(pose, centre_m), radius_m), pose)
    model = renderer.model
    row, column = np.unravel_index(amplitude.argmax(), amplitude.shape)
    assert abs(model.range_m[row] - range_m) <= model.range_step_m
    assert abs(model.bearing_rad[column] - bearing_rad) <= model.bearing_step_rad
    # The elevation of each echoing pixel lies within the ball as seen from the sonar.
    rows, columns = np.nonzero(np.isfinite(elevation))
    assert len(rows)
    spread_rad = np.arcsin(radius_m / (range_m + radius_m))
    assert np.all(np.abs(elevation[rows, columns] - elevation_rad) <= spread_rad + np.deg2rad(0.2))
    error = elevation[row, column] - elevation_rad
    if (
        abs(elevation_rad) + spread_rad < model.elevation_aperture_rad / 2
    ):  # the aperture does not cut the ball, which would shift the mean
        assert abs(error) <= np.deg2rad(0.2)


@pytest.mark.parametrize("preset", PRESETS)
def test_small_ball_is_at_its_range_bearing_and_elevation_for_every_sonar(preset: str) -> None:
    sonar, rng = PRESETS[preset], np.random.default_rng(len(preset))
    for _ in range(4):
        range_m = rng.uniform(sonar.range_min + 0.1, sonar.range_max - 0.3)
        half_deg = sonar.bearings_deg[-1] if sonar.bearings_deg else sonar.azimuth / 2
        bearing_rad, elevation_rad = np.deg2rad(rng.uniform(-0.96, 0.96, 2) * [half_deg, sonar.elevation / 2])
        radius_m = 0.01 + 0.006 * range_m  # a few rays across
        centre_m = back_project(np.array(range_m + radius_m), np.array(bearing_rad), elevation_rad)
        renderer, amplitude, elevation = _render(_ball(centre_m, radius_m), EYE, sonar)
        model = renderer.model
        row, column = np.unravel_index(amplitude.argmax(), amplitude.shape)
        assert abs(model.range_m[row] - range_m) <= model.range_step_m
        assert abs(model.column_at_bearing(np.array(bearing_rad)) - 0.5 - column) <= 1
        spread_rad = np.arcsin(radius_m / (range_m + radius_m))
        assert np.nanmax(np.abs(elevation - elevation_rad)) <= spread_rad + np.deg2rad(0.2)


def test_elevation_of_a_slanted_plate_is_that_of_the_plane() -> None:
    """On a plane the elevation of a pixel follows from its range and bearing."""
    normal = np.array([-0.35, 0.15, 0.8])
    normal /= np.linalg.norm(normal)
    offset = normal @ [3.0, 0.0, -0.2]
    basis = np.linalg.svd(normal[None])[2][1:]
    corners = normal * offset + np.array([[-9, -9], [9, -9], [9, 9], [-9, 9]]) @ basis
    plate = Scene("plate", corners, np.array([[0, 1, 2], [0, 2, 3]]), np.ones(2))
    renderer, _, elevation = _render(plate, EYE)
    rows, columns = np.nonzero(np.isfinite(elevation))
    assert len(rows) > 5000
    points = back_project(renderer.model.range_m[rows], renderer.model.bearing_rad[columns], elevation[rows, columns])
    # The error is converted to elevation along the slope; half a row and column are the size of the pixel.
    tilt = np.stack(
        [
            back_project(
                renderer.model.range_m[rows], renderer.model.bearing_rad[columns], elevation[rows, columns] + d
            )
            for d in (-1e-4, 1e-4)
        ]
    )
    slope = (tilt[1] - tilt[0]) @ normal / 2e-4
    error_rad = (points @ normal - offset) / slope
    assert np.rad2deg(np.quantile(np.abs(error_rad), 0.99)) <= 0.2


def test_starboard_is_column_zero_and_near_is_row_zero() -> None:
    """Three balls without symmetry: a mirrored bearing, range or elevation misses at least one of them."""
    places = [(2.0, np.deg2rad(-25.0), np.deg2rad(4.0)), (3.5, np.deg2rad(10.0), np.deg2rad(-5.0)), (5.0, 0.35, 0.0)]
    balls = [_ball(back_project(np.array(r + 0.05), np.array(b), e), 0.05) for r, b, e in places]
    _, amplitude, elevation = _render(join_scenes("balls", balls), EYE)
    rows, columns = SONAR.range_bins, SONAR.azimuth_bins
    for range_m, bearing_rad, elevation_rad in places:
        row = int((range_m - 0.5) / 5.5 * rows)
        column = int((np.rad2deg(bearing_rad) + 35) / 70 * columns)
        window = np.s_[row - 3 : row + 4, column - 2 : column + 3]
        assert amplitude[window].max() > 0.2 * amplitude.max()
        assert np.nanmedian(elevation[window]) == pytest.approx(elevation_rad, abs=np.deg2rad(0.5))
    assert amplitude[:, : columns // 2].max(axis=1).argmax() < rows // 2  # starboard holds only the near ball


def test_objects_cast_shadows_and_lay_over() -> None:
    """A ball casts a shadow on the wall behind it; wall and ball at the same range share pixels."""
    wall = trimesh.creation.box(extents=(0.1, 12, 12))
    scene = Scene("wall", wall.vertices + np.array([4.05, 0, 0]), np.asarray(wall.faces), np.ones(len(wall.faces)))
    ball = _ball(np.array([2.0, 0.0, 0.0]), 0.4)
    _, bare, _ = _render(scene, EYE)
    _, shaded, _ = _render(join_scenes("both", [scene, ball]), EYE)
    middle = SONAR.azimuth_bins // 2
    at_wall = np.s_[int((4.0 - 0.5) / 5.5 * SONAR.range_bins) :, middle - 4 : middle + 4]
    assert bare[at_wall].max() > 0
    assert shaded[at_wall].max() < 0.05 * bare[at_wall].max()


def test_open_mesh_echoes_from_both_sides() -> None:
    triangle = Scene("sheet", np.array([[3.0, -9, -9], [3, 9, -9], [3, 0, 9]]), np.array([[0, 1, 2]]), np.ones(1))
    flipped = Scene("sheet", triangle.vertices_m, triangle.faces[:, ::-1].copy(), triangle.reflectivity)
    assert np.array_equal(_render(triangle, EYE)[1], _render(flipped, EYE)[1])
    assert _render(triangle, EYE)[1].max() > 0


def test_nothing_in_view_is_an_empty_image() -> None:
    _, amplitude, elevation = _render(_ball(np.array([-4.0, 0, 0]), 0.5), EYE)
    assert amplitude.max() == 0
    assert np.isnan(elevation).all()


def test_empty_mesh_is_refused() -> None:
    empty = Scene("void", np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64), np.zeros(0))
    with pytest.raises(AsfmError, match="void: expected a mesh with faces, found none"):
        RayCaster(empty)


def test_image_depends_only_on_the_relative_pose() -> None:
    """The same relative pose gives the same image wherever scene and sonar are."""
    from scipy.spatial.transform import Rotation

    ball = _ball(np.array([3.0, 0.4, -0.1]), 0.3)
    move = make_pose(np.array([40.0, -20.0, 7.0]), Rotation.from_euler("ZYX", [0.4, 0.5, -2.0]))
    moved = Scene("ball", transform(move, ball.vertices_m), ball.faces, ball.reflectivity)
    here, there = _render(ball, EYE)[1], _render(moved, move)[1]
    assert np.abs(here - there).max() < 0.02 * here.max()
    assert np.allclose(invert(move) @ move, EYE)
    assert project(np.array([3.0, 0.4, -0.1]))[1] > 0
