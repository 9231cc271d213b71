"""Catalogue of scenes: every scene is outside of the sonar and in view, for every sonar."""

from functools import cache

import numpy as np
import pytest

from asfm.errors import AsfmError
from asfm.simulation.acoustics.rays import RayCaster, make_ray_fan
from asfm.simulation.placement_checks import check_outside, count_empty_views
from asfm.simulation.scenes.catalogue import SCENES
from asfm.simulation.scenes.scene import Scene
from asfm.simulation.simulate import simulate, simulate_path
from asfm.simulation.sonars.parameters import make_sonar_model
from asfm.simulation.sonars.presets import PRESETS
from asfm.simulation.vehicle.trajectories import MOTIONS, View
from asfm.types import FloatArray, Trajectory


def _place(*xyz: float) -> FloatArray:
    pose = np.eye(4)
    pose[:3, 3] = xyz
    return pose[None]


@pytest.mark.parametrize("name", SCENES)
def test_scene_is_wound_outward_and_in_view_along_its_motion(name: str) -> None:
    simulated = simulate(name, frame_count=30, seed=2)
    scene, sequence = simulated.scene, simulated.sequence
    assert np.isfinite(scene.vertices_m).all() and scene.reflectivity.min() > 0
    assert scene.faces.min() >= 0 and scene.faces.max() < len(scene.vertices_m)
    assert sequence.diagnostics == ()
    for index in (0, 15, 29):
        truth = simulated.read_truth(index)
        assert np.isfinite(truth.elevation_rad).mean() > 0.08
        assert 0.1 < np.median(truth.clean[np.isfinite(truth.elevation_rad)]) < 0.8
    assert sequence.groundtruth is not None
    hits = simulated.renderer.cast(sequence.groundtruth.world_from_vehicle[0])
    seen = hits.face >= 0
    assert (hits.cos_incidence[seen] > 0).mean() < 0.02  # hardly any back face in view


@pytest.fixture(scope="module")
def hull() -> Scene:
    return SCENES["hull"].make(np.random.default_rng(0))


@pytest.mark.parametrize("preset", PRESETS)
def test_preset_sees_the_hull(preset: str, hull: Scene) -> None:
    sonar = PRESETS[preset]
    level = View((0.0, 0.0, 0.0), 1.2, -0.45, 0.6 * sonar.range_max)
    times_s = np.linspace(0.0, 0.2, 2)
    simulated = simulate_path(
        hull, sonar, Trajectory(times_s, MOTIONS["hover"](level, times_s, np.random.default_rng(0)))
    )
    frame, truth = simulated.sequence.read_frame(1), simulated.read_truth(1)
    assert frame.image.shape == (PRESETS[preset].range_bins, PRESETS[preset].azimuth_bins)
    assert np.isfinite(truth.elevation_rad).mean() > 0.08
    assert np.all(np.diff(simulated.sequence.sonar.bearing_rad) > 0)
    assert np.abs(simulated.sequence.sonar.bearing_rad + simulated.sequence.sonar.bearing_rad[::-1]).max() < 0.02


@cache
def _build(name: str) -> tuple[Scene, RayCaster]:
    scene = SCENES[name].make(np.random.default_rng(1))
    return scene, RayCaster(scene)


@pytest.mark.parametrize("preset", ["didson", "oculus_m750d_low", "aris_3000"])
@pytest.mark.parametrize("name", SCENES)
def test_usual_motion_stays_outside_and_in_view_for_forty_seconds(name: str, preset: str) -> None:
    """In steps of two seconds: never inside an object, never an empty view."""
    sonar, (scene, caster) = PRESETS[preset], _build(name)
    view = SCENES[name].look(sonar.range_max)
    poses = MOTIONS[SCENES[name].motion](view, np.arange(0.0, 41.0, 2.0), np.random.default_rng(1))
    check_outside(scene, caster, poses)
    fan = make_ray_fan(make_sonar_model(sonar), 24)
    assert count_empty_views(caster, fan, poses, (sonar.range_min, sonar.range_max)) == 0


@pytest.mark.parametrize("name", SCENES)
def test_sonar_inside_objects_of_a_scene_is_refused(name: str) -> None:
    """Two centimetres behind almost any face is inside; thin plates and intersections are the exceptions."""
    rng, (scene, caster) = np.random.default_rng(3), _build(name)
    corners_m = scene.vertices_m[scene.faces[rng.integers(len(scene.faces), size=40)]]
    normal = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    inside_m = corners_m.mean(axis=1) - 0.02 * normal / np.linalg.norm(normal, axis=1, keepdims=True)
    refused = 0
    for x, y, z in inside_m:
        try:
            check_outside(scene, caster, _place(x, y, z))
        except AsfmError as error:
            refused += "is inside an object" in str(error)
    assert refused >= 37
