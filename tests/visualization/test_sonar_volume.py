"""Sonar volume: frustum and image plane agree with the sonar model."""

import numpy as np
import pytest

from asfm.geometry.sonar import SonarModel, project
from asfm.visualization.sonar_volume import outline_frustum, tessellate_image_plane

SONAR = SonarModel.evenly_spaced("toy", (0.5, 8.0), (-0.6, 0.5), (150, 110), 0.2)

UNEVEN = SonarModel("uneven", np.linspace(1.0, 5.0, 40), 0.5 * np.linspace(-1, 1, 31) ** 3, 0.3)


@pytest.mark.parametrize("sonar", [SONAR, UNEVEN], ids=lambda sonar: str(sonar.name))
def test_frustum_follows_the_edges_of_the_field_of_view(sonar: SonarModel) -> None:
    """Every point is on at least two of the six faces: visible just inside, invisible just outside."""
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
def test_image_plane_covers_zero_elevation_once(sonar: SonarModel) -> None:
    sheet = tessellate_image_plane(sonar)
    xyz_m, triangles = sheet["vertex_positions"], sheet["triangle_indices"]
    assert (xyz_m[:, 2] == 0).all()
    a, b, c = xyz_m[triangles].transpose(1, 0, 2)
    area_m2 = 0.5 * np.cross(b - a, c - a)[:, 2]
    assert abs(np.sign(area_m2).sum()) == len(area_m2), "all triangles face the same way"
    near_m, far_m = sonar.range_edges_m[[0, -1]]
    expected_m2 = 0.5 * np.ptp(sonar.bearing_edges_rad) * (far_m**2 - near_m**2)
    assert np.abs(area_m2).sum() == pytest.approx(expected_m2, rel=2e-3)


@pytest.mark.parametrize("sonar", [SONAR, UNEVEN], ids=lambda sonar: str(sonar.name))
def test_texture_coordinates_match_range_and_bearing(sonar: SonarModel) -> None:
    sheet = tessellate_image_plane(sonar)
    range_m, bearing_rad, _ = project(sheet["vertex_positions"])
    pixel = np.stack([sonar.column_at_bearing(bearing_rad), sonar.row_at_range(range_m)], axis=-1)
    np.testing.assert_allclose(pixel / sonar.shape[::-1], sheet["vertex_texcoords"], atol=1e-6)
