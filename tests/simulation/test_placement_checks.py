"""Placement checks: the sonar outside of objects and within reach of the scene, and empty views."""

import numpy as np
import pytest

from asfm.errors import AsfmError
from asfm.simulation.acoustics.rays import RayCaster, make_ray_fan
from asfm.simulation.placement_checks import check_distance, check_outside, count_empty_views
from asfm.simulation.scenes.scene import Scene
from asfm.simulation.scenes.seafloor import make_seafloor
from asfm.simulation.scenes.shapes import make_ball, move_mesh
from asfm.simulation.simulate import simulate_path
from asfm.simulation.sonars.parameters import make_sonar_model
from asfm.simulation.sonars.presets import PRESETS
from asfm.types import FloatArray, Trajectory


def _place(*xyz: float) -> FloatArray:
    pose = np.eye(4)
    pose[:3, 3] = xyz
    return pose[None]


def _ball(radius_m: float, x_m: float = 0.0) -> Scene:
    vertices_m, faces = move_mesh(make_ball(radius_m), (x_m, 0.0, 0.0))
    return Scene("ball", vertices_m, faces, np.ones(len(faces)))


def test_sonar_inside_an_object_is_refused() -> None:
    path = Trajectory(np.array([0.0, 0.2]), np.concatenate([_place(-5, 0, 0), _place(0.3, 0.2, 0.1)]))
    with pytest.raises(AsfmError, match=r"scene ball: at frame 1 the sonar at \(0.30, 0.20, 0.10\) m is inside"):
        simulate_path(_ball(2.0), PRESETS["oculus_m750d_high"], path)


def test_sonar_below_the_ground_is_refused_and_above_it_is_not() -> None:
    scene = make_seafloor(np.random.default_rng(1), size_m=(8.0, 8.0))
    caster = RayCaster(scene)
    check_outside(scene, caster, np.concatenate([_place(0, 0, 2.0), _place(2, 2, 1.5)]))
    with pytest.raises(AsfmError, match="inside an object"):
        check_outside(scene, caster, _place(0, 0, -1.0))


def test_distance_is_measured_from_the_centre_of_the_scene_and_need_not_be_small() -> None:
    ball = _ball(1.0, x_m=5e6)
    check_distance(ball, np.concatenate([_place(5e6 + 9.9e4, 0, 0), _place(5e6, -9.9e4, 0)]))
    with pytest.raises(AsfmError, match=r"at frame 1 the sonar is 5e\+06 m away, expected at most 100000 m"):
        check_distance(ball, np.concatenate([_place(5e6, 0, 3), _place(0, 0, 0)]))
    with pytest.raises(AsfmError, match="at frame 0"):
        check_distance(ball, _place(np.nan, 0, 0))


def test_empty_views_are_those_without_a_hit_between_nearest_and_farthest_range() -> None:
    caster, fan = RayCaster(_ball(0.5)), make_ray_fan(make_sonar_model(PRESETS["oculus_m750d_high"]), 60)
    behind, in_view, too_near, too_far = _place(3, 0, 0), _place(-3, 0, 0), _place(-0.6, 0, 0), _place(-9, 0, 0)
    for pose, empty in ((behind, 1), (in_view, 0), (too_near, 1), (too_far, 1)):
        assert count_empty_views(caster, fan, pose, (0.5, 8.0)) == empty
    assert count_empty_views(caster, fan, np.concatenate([behind, in_view, too_far]), (0.5, 8.0)) == 2


def test_empty_view_is_an_image_of_noise_with_a_diagnostic() -> None:
    triangle = Scene("far", np.array([[90.0, 0, 0], [90, 1, 0], [90, 0, 1]]), np.array([[0, 2, 1]]), np.ones(1))
    sonar = PRESETS["oculus_m750d_high"]
    simulated = simulate_path(triangle, sonar, Trajectory(np.array([0.0, 0.2]), np.tile(np.eye(4), (2, 1, 1))))
    (found,) = simulated.sequence.diagnostics
    assert found.code == "empty-frames"
    assert found.message == "2 of 2 frames see nothing of far within 8.0 m; it is 1 m across"
    image, truth = simulated.sequence.read_frame(0).image, simulated.read_truth(0)
    assert image.mean() == pytest.approx(sonar.add_sigma * np.sqrt(np.pi / 2), rel=0.02)
    assert np.isnan(truth.elevation_rad).all() and truth.clean.max() == 0
