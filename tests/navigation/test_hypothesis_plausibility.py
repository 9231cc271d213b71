"""Plausibility of hypotheses: agreement with depth and attitude first, then the view towards the scene, then order."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.config import BackendConfig, Scene
from asfm.geometry.poses import make_pose
from asfm.navigation.depth_attitude import DepthAttitude
from asfm.navigation.fault_hypotheses import Hypothesis
from asfm.navigation.frame_navigation import read_navigation
from asfm.navigation.hypothesis_plausibility import sort_by_plausibility
from asfm.navigation.odometry_hypotheses import to_marine_axes
from asfm.types import FloatArray
from tests.worlds import make_vehicle_path, make_vehicle_sequence, mirror_angle

NO_READINGS = DepthAttitude(np.zeros((0, 3)), np.zeros((0, 3)))


def order(hypotheses: list[Hypothesis], readings: DepthAttitude = NO_READINGS, scene: Scene = "unknown") -> list[str]:
    return [item.name for item in sort_by_plausibility(hypotheses, readings, make_vehicle_sequence(), scene)]


def pitch_down(degrees: float) -> FloatArray:
    sequence = make_vehicle_sequence()

    turn = (
        Rotation.from_euler("y", degrees, degrees=True)
        * Rotation.from_matrix(sequence.vehicle_from_sonar[:3, :3]).inv()
    )
    return np.tile(make_pose(np.zeros(3), turn), (5, 1, 1))


def test_agreement_with_the_readings_comes_first() -> None:
    sequence = replace(make_vehicle_sequence(), odometry=None)
    readings = read_navigation(sequence, BackendConfig()).depth_attitude
    right, rolled = Hypothesis("right", make_vehicle_path()), Hypothesis("rolled", mirror_angle(2)(make_vehicle_path()))
    marine = Hypothesis("marine", to_marine_axes(make_vehicle_path()), (-1, 1, -1))
    wrong_signs = Hypothesis("wrong signs", make_vehicle_path(), (-1, 1, -1))
    names = order([wrong_signs, rolled, marine, right], readings)
    assert names[-2:] == ["rolled", "wrong signs"]


def test_sonars_usually_look_down_and_up_where_the_scene_is_above() -> None:
    up, down = Hypothesis("up", pitch_down(-30)), Hypothesis("down", pitch_down(30))
    assert order([up, down]) == ["down", "up"] == order([up, down], scene="below")
    assert order([down, up], scene="above") == ["up", "down"]


def test_equally_plausible_hypotheses_keep_their_order_and_unknown_poses_do_not_matter() -> None:
    level, lower = Hypothesis("level", pitch_down(-2)), Hypothesis("lower", pitch_down(20))
    assert order([level, lower]) == ["level", "lower"]
    poses = pitch_down(20)
    poses[1:] = np.nan
    assert order([Hypothesis("partly", poses), lower]) == ["partly", "lower"]
