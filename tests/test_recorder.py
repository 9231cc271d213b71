"""The recorder that discards everything."""

import subprocess
import sys

import numpy as np

from asfm.geometry.sonar import SonarModel
from asfm.recorder import NullRecorder, Recorder
from asfm.sequence import Sequence
from asfm.types import Frame, Keypoints, Landmarks, Matches, Reconstruction, Tracks, Trajectory

SONAR = SonarModel.evenly_spaced("toy sonar", (0.5, 8.0), (-0.6, 0.5), (15, 11), 0.2)


def make_empty_run() -> tuple[Frame, Keypoints, Sequence, Reconstruction]:
    none, few = np.zeros(0, int), np.zeros(0)
    frame = Frame(0, 0.0, np.zeros(SONAR.shape, np.float32), np.zeros(SONAR.shape, bool))
    keypoints = Keypoints(np.zeros((0, 2)), few, few, few, np.zeros((0, 61), np.uint8), np.zeros((0, 3, 3), np.float32))
    landmarks = Landmarks(none, np.zeros((0, 3)), np.zeros((0, 3, 3)), few, none, none > 0, np.zeros((0, 15, 3)))
    trajectory = Trajectory(np.zeros(1), np.eye(4)[None])
    sequence = Sequence("toy", SONAR, trajectory.timestamps_s, lambda index: frame)
    return (
        frame,
        keypoints,
        sequence,
        Reconstruction(trajectory, Tracks(none, none, few, few), none > 0, landmarks, np.zeros((0, 6, 6)), ()),
    )


def test_null_recorder_accepts_every_call() -> None:
    recorder: Recorder = NullRecorder()
    frame, keypoints, sequence, reconstruction = make_empty_run()
    recorder.record_frame(frame, frame.invalid, keypoints)
    recorder.record_matches(keypoints, keypoints, Matches(0, 1, np.zeros((0, 2), int), np.zeros(0)))
    recorder.record_reconstruction(sequence=sequence, reconstruction=reconstruction)
    recorder.close()


def test_importing_the_module_loads_nothing_heavy() -> None:
    code = "import sys, asfm.recorder; sys.exit(bool({'rerun', 'cv2', 'gtsam'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
