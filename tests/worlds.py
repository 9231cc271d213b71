"""Builders that many tests share: sequences without images, and the constraints of their sensors."""

from dataclasses import replace

import numpy as np

from asfm.config import BackendConfig
from asfm.navigation.frame_navigation import read_navigation
from asfm.navigation.sensor_constraints import SensorConstraints, sensor_constraints
from asfm.sequence import Sequence
from asfm.types import FloatArray, Frame, Tracks

BACKEND = BackendConfig()


def no_frame(index: int) -> Frame:
    """Stand in for the reader of a sequence whose images must not be read."""
    raise AssertionError(f"frame {index} must not be read")


def make_constraints(
    sequence: Sequence, poses: FloatArray, step_sigma: FloatArray, measured: bool, config: BackendConfig = BACKEND
) -> SensorConstraints:
    """Make the constraints of a sequence's sensors on (N, 4, 4) poses with (N - 1, 2) sigmas of their steps."""
    return sensor_constraints(sequence, read_navigation(sequence, config), poses, step_sigma, measured)


def number_keypoints(tracks: Tracks) -> Tracks:
    """Let tracks know their keypoints: each frame's are its observations, in the order of the tracks."""
    keypoint = np.empty(len(tracks), dtype=np.int64)
    for observations in tracks.by_frame(int(tracks.frame.max(initial=-1)) + 1):
        keypoint[observations] = np.arange(len(observations))
    return replace(tracks, keypoint=keypoint)
