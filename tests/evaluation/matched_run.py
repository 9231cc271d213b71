"""A run of four frames with known matches, for the tests of matcher quality."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from asfm.geometry.poses import invert, make_pose
from asfm.sequence import Sequence
from asfm.types import Frame, FrameTruth, Keypoints, Matches, Trajectory
from tests.evaluation.test_matching import A_FROM_B, SONAR, matches_of, same, scene, shifted


class MatchedRun:
    """Four frames, alternately at a and at b; frames 0 and 1 have 12 right and 4 wrong matches, 0 and 3 three right."""

    def __init__(self, range_error_m: float = 0.0, bearing_error_rad: float = 0.0) -> None:
        a, b, self.elevation_rad = scene(30)
        b = replace(b, range_m=b.range_m + range_error_m, bearing_rad=b.bearing_rad + bearing_error_rad)
        self.keypoints: list[Keypoints] = [a, b, a, b]
        self.matches: list[Matches] = [
            matches_of([*same(12), *shifted(b, 4)], 0, 1),
            matches_of(same(3), 0, 3),
            matches_of([], 2, 3),
        ]
        world_from_a = make_pose(np.array([9.0, -4, 2]), Rotation.from_euler("z", 1.0))
        lever_arm = make_pose(np.array([0.4, 0.1, -0.2]), Rotation.from_euler("zyx", [5, 20, -3], degrees=True))
        world_from_sonar = np.stack([world_from_a, world_from_a @ A_FROM_B] * 2)
        stamps_s = np.arange(4.0)
        self.sequence = Sequence(
            name="made up",
            sonar=SONAR,
            timestamps_s=stamps_s,
            read_frame=_no_image,
            vehicle_from_sonar=lever_arm,
            groundtruth=Trajectory(stamps_s, world_from_sonar @ invert(lever_arm)),
        )

    def read_truth(self, index: int) -> FrameTruth:
        """Return the elevations of frame a; those of b hold nothing."""
        elevation_rad = self.elevation_rad if index in (0, 2) else np.full(SONAR.shape, np.nan)
        return FrameTruth(elevation_rad, np.zeros(SONAR.shape, np.float32))


def _no_image(index: int) -> Frame:
    raise AssertionError(f"matches are evaluated without images, frame {index} was requested")
