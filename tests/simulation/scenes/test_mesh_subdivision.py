"""Subdivision of faces: the surface stays, edges become short, and narrow faces do not explode."""

import numpy as np
import pytest
import trimesh

from asfm.simulation.scenes.mesh_subdivision import count_quarters, cut_long_faces


def test_cuts_keep_area_winding_and_plane() -> None:
    box = trimesh.creation.box(extents=(3.0, 0.2, 0.1))
    vertices_m, faces = cut_long_faces(np.asarray(box.vertices), np.asarray(box.faces), 0.15, 10**6)
    fine = trimesh.Trimesh(vertices_m, faces, process=False)
    assert fine.edges_unique_length.max() <= 0.15
    assert fine.area == pytest.approx(box.area) and fine.volume == pytest.approx(box.volume)
    assert np.abs(vertices_m).max(axis=0) == pytest.approx([1.5, 0.1, 0.05])


def test_faces_of_a_pole_grow_with_its_length_only() -> None:
    def count(length_m: float) -> int:
        pole = trimesh.creation.cylinder(radius=0.1, height=length_m, sections=64)
        return len(cut_long_faces(np.asarray(pole.vertices), np.asarray(pole.faces), 0.1, 10**7)[1])

    assert count(40.0) < 2.2 * count(20.0) and count(40.0) < 200_000
    pole = trimesh.creation.cylinder(radius=0.1, height=40.0, sections=64)
    assert count_quarters(np.asarray(pole.vertices), np.asarray(pole.faces), 0.1) > 10**7


def test_the_number_of_faces_is_bounded() -> None:
    sheet = np.array([[0.0, 0, 0], [1000, 0, 0], [0, 1000, 0]])
    assert 250 < len(cut_long_faces(sheet, np.array([[0, 1, 2]]), 0.01, 1000)[1]) <= 1000
