"""points.ply: read back by an independent reader."""

from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from asfm.errors import AsfmError
from asfm.results.points_ply import read_points, write_points
from asfm.types import Landmarks


def make_landmarks(count: int, seed: int = 0) -> Landmarks:
    rng = np.random.default_rng(seed)
    return Landmarks(
        track=np.arange(count),
        xyz_m=np.array([4e6, 5e5, -20]) + rng.normal(0, 50, (count, 3)),
        covariance_m2=np.tile(np.eye(3), (count, 1, 1)),
        sigma_m=rng.uniform(0.01, 2, count),
        views=rng.integers(2, 100_000, count),
        well_constrained=rng.random(count) < 0.5,
        arc_m=rng.normal(size=(count, 5, 3)),
    )


@pytest.mark.parametrize("count", [0, 1, 50])
def test_points_read_by_trimesh(tmp_path: Path, count: int) -> None:
    ply = pytest.importorskip("trimesh.exchange.ply")
    landmarks = make_landmarks(count)
    path = tmp_path / "points.ply"
    write_points(path, landmarks)
    if not count:
        assert b"element vertex 0\n" in path.read_bytes() and path.read_bytes().endswith(b"end_header\n")
        return
    read = ply.load_ply(BytesIO(path.read_bytes()))
    vertices = read["metadata"]["_ply_raw"]["vertex"]["data"]
    xyz_m = np.column_stack([vertices[axis] for axis in "xyz"])
    np.testing.assert_array_equal(xyz_m, landmarks.xyz_m)
    np.testing.assert_array_equal(np.ravel(vertices["sigma_m"]), landmarks.sigma_m.astype(np.float32))
    np.testing.assert_array_equal(np.ravel(vertices["views"]), landmarks.views)
    np.testing.assert_array_equal(np.ravel(vertices["well_constrained"]), landmarks.well_constrained)


@pytest.mark.parametrize("count", [0, 1, 50])
def test_points_are_read_back_and_damage_is_a_one_line_error(tmp_path: Path, count: int) -> None:
    landmarks, path = make_landmarks(count), tmp_path / "points.ply"
    write_points(path, landmarks)
    points = read_points(path)
    for name in ("xyz_m", "views", "well_constrained"):
        np.testing.assert_array_equal(getattr(points, name), getattr(landmarks, name))
    np.testing.assert_allclose(points.sigma_m, landmarks.sigma_m, rtol=1e-6)
    whole = path.read_bytes()
    for damaged in (whole[:-1], whole + b"x", whole[1:], whole.replace(b"double y", b"float y"), b""):
        path.write_bytes(damaged)
        with pytest.raises(AsfmError, match=r"^[^\n]*points\.ply: expected the points of asfm run[^\n]*$"):
            read_points(path)
    path.unlink()
    with pytest.raises(AsfmError, match=r"^[^\n]*points\.ply: expected the points of asfm run, found none"):
        read_points(path)
