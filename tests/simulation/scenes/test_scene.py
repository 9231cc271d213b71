"""Scenes joined: faces keep their corners and reflectivity, and one open mesh makes the whole open."""

import numpy as np

from asfm.simulation.scenes.scene import Scene, join_scenes


def _scene(seed: int, vertices: int, faces: int, grain: float, winds_outward: bool) -> Scene:
    rng = np.random.default_rng(seed)
    corners = rng.integers(0, vertices, (faces, 3))
    return Scene("part", rng.normal(size=(vertices, 3)), corners, rng.uniform(size=faces), grain, winds_outward)


def test_joined_faces_keep_their_corners_and_reflectivity() -> None:
    parts = [_scene(0, 5, 7, 0.1, True), _scene(1, 3, 2, 0.4, True), _scene(2, 8, 1, 0.0, True)]
    joined = join_scenes("whole", parts)
    assert joined.name == "whole" and joined.grain == 0.4 and joined.winds_outward
    corners_m = np.concatenate([part.vertices_m[part.faces] for part in parts])
    np.testing.assert_array_equal(joined.vertices_m[joined.faces], corners_m)
    np.testing.assert_array_equal(joined.reflectivity, np.concatenate([part.reflectivity for part in parts]))


def test_one_open_part_makes_the_whole_open() -> None:
    assert not join_scenes("whole", [_scene(0, 5, 7, 0.0, True), _scene(1, 3, 2, 0.0, False)]).winds_outward
