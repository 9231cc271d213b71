"""Sonar model: equations (1) and (2), the pixel grid with even and uneven beams, elevation arcs, field of view."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from asfm.geometry.sonar import SonarModel, back_project, edges_from_centres, project, project_jacobian
from asfm.types import FloatArray

ranges = st.floats(0.01, 300)
bearings = st.floats(-3.1, 3.1)
elevations = st.floats(-1.5, 1.5)
coordinates = st.floats(-50, 50, allow_subnormal=False)


@st.composite
def uneven_sonars(draw: st.DrawFn) -> SonarModel:
    rows, columns = draw(st.integers(2, 40)), draw(st.integers(2, 40))
    row_steps = draw(hnp.arrays(float, rows, elements=st.floats(1e-3, 0.1)))
    column_steps = draw(hnp.arrays(float, columns, elements=st.floats(1e-3, 0.05)))
    return SonarModel(
        name="uneven",
        range_m=draw(st.floats(0.0, 5.0)) + np.cumsum(row_steps),
        bearing_rad=draw(st.floats(-1.2, 0.0)) + np.cumsum(column_steps),
        elevation_aperture_rad=draw(st.floats(0.05, 0.6)),
    )


def even_sonar() -> SonarModel:
    return SonarModel.evenly_spaced("even", (0.5, 8.0), (-0.6, 0.4), (600, 256), 0.2)


@given(ranges, bearings, elevations)
def test_projection_inverts_back_projection(range_m: float, bearing_rad: float, elevation_rad: float) -> None:
    xyz_m = back_project(np.array(range_m), np.array(bearing_rad), elevation_rad)
    np.testing.assert_allclose(project(xyz_m), (range_m, bearing_rad, elevation_rad), rtol=1e-12, atol=1e-12)


@given(hnp.arrays(float, (5, 2, 3), elements=coordinates))
def test_back_projection_inverts_projection(xyz_m: FloatArray) -> None:
    assert back_project(*project(xyz_m)).shape == xyz_m.shape
    np.testing.assert_allclose(back_project(*project(xyz_m)), xyz_m, atol=1e-12)


def test_projection_of_known_points() -> None:
    points = np.array([[2.0, 0.0, 0.0], [0.0, 3.0, 0.0], [1.0, -1.0, 0.0], [3.0, 4.0, 5.0], [0.0, 0.0, -2.0]])
    range_m, bearing_rad, elevation_rad = project(points)
    np.testing.assert_allclose(range_m, [2, 3, np.sqrt(2), np.sqrt(50), 2])
    np.testing.assert_allclose(bearing_rad[:4], [0, np.pi / 2, -np.pi / 4, np.arctan(4 / 3)])
    np.testing.assert_allclose(elevation_rad, [0, 0, 0, np.pi / 4, -np.pi / 2])


def test_port_is_positive_and_up_is_positive() -> None:
    port_and_up = back_project(np.array(1.0), np.array(0.3), 0.2)
    assert port_and_up[1] > 0
    assert port_and_up[2] > 0
    sonar = even_sonar()
    port, starboard = sonar.column_at_bearing(np.array([0.3, -0.3]))
    assert port > starboard


@given(ranges, bearings, st.floats(-1.4, 1.4))
def test_the_jacobian_is_that_of_central_differences(range_m: float, bearing_rad: float, elevation_rad: float) -> None:
    xyz_m = back_project(np.array(range_m), np.array(bearing_rad), elevation_rad)
    step_m = 1e-6 * range_m
    columns = []
    for offset in step_m * np.eye(3):
        ahead, behind = project(xyz_m + offset), project(xyz_m - offset)
        difference = np.array(ahead) - np.array(behind)
        difference[1] = np.angle(np.exp(1j * difference[1]))
        columns.append(difference / (2 * step_m))
    expected = np.stack(columns, axis=-1)
    np.testing.assert_allclose(project_jacobian(xyz_m), expected, rtol=1e-5, atol=1e-6 * (1 + 1 / range_m))
    assert project_jacobian(np.ones((4, 2, 3))).shape == (4, 2, 3, 3)


def test_back_projection_broadcasts() -> None:
    xyz_m = back_project(np.array([1.0, 2.0])[:, None], np.array([0.1, 0.2, 0.3])[None], 0.1)
    assert xyz_m.shape == (2, 3, 3)
    np.testing.assert_allclose(np.linalg.norm(xyz_m, axis=-1), [[1, 1, 1], [2, 2, 2]])


def test_evenly_spaced_keeps_the_outer_edges() -> None:
    sonar = even_sonar()
    assert sonar.shape == (600, 256)
    np.testing.assert_allclose(sonar.range_edges_m, np.linspace(0.5, 8.0, 601), atol=1e-12)
    np.testing.assert_allclose(sonar.bearing_edges_rad, np.linspace(-0.6, 0.4, 257), atol=1e-12)
    np.testing.assert_allclose(sonar.range_step_m, 7.5 / 600)
    np.testing.assert_allclose(sonar.bearing_step_rad, 1.0 / 256)


@given(uneven_sonars())
def test_centres_lie_at_half_pixels_and_edges_at_whole_ones(sonar: SonarModel) -> None:
    rows, columns = np.arange(float(sonar.shape[0])), np.arange(float(sonar.shape[1]))
    np.testing.assert_allclose(sonar.range_at_row(rows + 0.5), sonar.range_m)
    np.testing.assert_allclose(sonar.bearing_at_column(columns + 0.5), sonar.bearing_rad)
    np.testing.assert_allclose(sonar.row_at_range(sonar.range_edges_m), np.arange(sonar.shape[0] + 1), atol=1e-9)
    np.testing.assert_allclose(
        sonar.column_at_bearing(sonar.bearing_edges_rad), np.arange(sonar.shape[1] + 1), atol=1e-9
    )


@given(uneven_sonars(), hnp.arrays(float, 20, elements=st.floats(0, 1)))
def test_maps_between_pixels_and_metres_are_inverse(sonar: SonarModel, fraction: FloatArray) -> None:
    rows, columns = fraction * sonar.shape[0], fraction * sonar.shape[1]
    np.testing.assert_allclose(sonar.row_at_range(sonar.range_at_row(rows)), rows, atol=1e-8)
    np.testing.assert_allclose(sonar.column_at_bearing(sonar.bearing_at_column(columns)), columns, atol=1e-8)


@given(uneven_sonars())
def test_pixels_outside_are_clipped_to_the_edges(sonar: SonarModel) -> None:
    far = np.array([-1e6, 1e6])
    np.testing.assert_array_equal(sonar.row_at_range(far), [0, sonar.shape[0]])
    np.testing.assert_array_equal(sonar.column_at_bearing(far), [0, sonar.shape[1]])
    np.testing.assert_array_equal(sonar.range_at_row(far), sonar.range_edges_m[[0, -1]])
    np.testing.assert_array_equal(sonar.bearing_at_column(far), sonar.bearing_edges_rad[[0, -1]])


@given(uneven_sonars())
def test_edges_enclose_their_centres_and_are_not_negative_in_range(sonar: SonarModel) -> None:
    for centres, edges in ((sonar.range_m, sonar.range_edges_m), (sonar.bearing_rad, sonar.bearing_edges_rad)):
        assert len(edges) == len(centres) + 1
        assert np.all(edges[:-1] <= centres)
        assert np.all(centres < edges[1:])
    assert sonar.range_edges_m[0] >= 0


def test_edges_of_known_uneven_centres() -> None:
    np.testing.assert_allclose(edges_from_centres(np.array([1.0, 2.0, 5.0])), [0.5, 1.5, 3.5, 6.5])
    with pytest.raises(ValueError, match="at least two"):
        edges_from_centres(np.array([1.0]))


def test_edges_do_not_modify_the_centres() -> None:
    sonar = SonarModel("near", np.array([0.01, 0.05, 0.09]), np.array([-0.1, 0.1]), 0.2)
    assert sonar.range_edges_m[0] == 0.0
    np.testing.assert_array_equal(sonar.range_m, [0.01, 0.05, 0.09])


@given(uneven_sonars(), st.floats(0.01, 0.99), st.floats(0.01, 0.99), st.integers(2, 30))
def test_elevation_arcs_project_to_their_pixel(sonar: SonarModel, row: float, column: float, count: int) -> None:
    range_m = sonar.range_at_row(np.array(row * sonar.shape[0]))
    bearing_rad = sonar.bearing_at_column(np.array(column * sonar.shape[1]))
    arc_m = sonar.elevation_arc(range_m, bearing_rad, count)
    assert arc_m.shape == (count, 3)
    found_range_m, found_bearing_rad, found_elevation_rad = project(arc_m)
    np.testing.assert_allclose(sonar.row_at_range(found_range_m), row * sonar.shape[0], atol=1e-8)
    np.testing.assert_allclose(sonar.column_at_bearing(found_bearing_rad), column * sonar.shape[1], atol=1e-8)
    half = sonar.elevation_aperture_rad / 2
    np.testing.assert_allclose(found_elevation_rad, np.linspace(-half, half, count), atol=1e-12)
    assert np.all(sonar.sees(sonar.elevation_arc(range_m, bearing_rad, count + 2)[1:-1]))


def test_arcs_keep_the_leading_axes() -> None:
    sonar = even_sonar()
    arcs_m = sonar.elevation_arc(np.full((4, 5), 2.0), np.full((4, 5), 0.1), 7)
    assert arcs_m.shape == (4, 5, 7, 3)
    np.testing.assert_allclose(
        arcs_m, np.broadcast_to(sonar.elevation_arc(np.array(2.0), np.array(0.1), 7), (4, 5, 7, 3))
    )


@pytest.mark.parametrize(
    ("range_m", "bearing_rad", "elevation_rad", "seen"),
    [
        (4.0, 0.0, 0.0, True),
        (0.51, -0.59, -0.099, True),
        (7.99, 0.39, 0.099, True),
        (0.49, 0.0, 0.0, False),
        (8.01, 0.0, 0.0, False),
        (4.0, 0.41, 0.0, False),
        (4.0, -0.61, 0.0, False),
        (4.0, 0.5, 0.0, False),  # visible if the bearing axis were mirrored
        (4.0, -0.5, 0.0, True),
        (4.0, 0.0, 0.101, False),
        (4.0, 0.0, -0.101, False),
        (4.0, np.pi, 0.0, False),
    ],
)
def test_field_of_view(range_m: float, bearing_rad: float, elevation_rad: float, seen: bool) -> None:
    xyz_m = back_project(np.array(range_m), np.array(bearing_rad), elevation_rad)
    assert bool(even_sonar().sees(xyz_m)) is seen


def test_steps_are_those_of_most_rows_and_columns() -> None:
    range_m = np.append([0.2, 0.9], 1.0 + 0.02 * np.arange(30))
    bearing_rad = np.append([-0.9, -0.6], -0.5 + 0.01 * np.arange(40))
    sonar = SonarModel("uneven", range_m, bearing_rad, 0.3)
    assert (sonar.range_step_m, sonar.bearing_step_rad) == pytest.approx((0.02, 0.01))
