"""Summary: counts and diagnostics of a run."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.diagnostics import Diagnostic
from asfm.geometry.poses import make_pose
from asfm.geometry.sonar import SonarModel
from asfm.sequence import Sequence
from asfm.types import Frame, Reconstruction, Tracks, Trajectory
from asfm.visualization.summary import summarise_run
from tests.worlds import make_landmarks

SONAR = SonarModel.evenly_spaced("toy", (0.5, 8.0), (-0.6, 0.5), (150, 110), 0.2)


def make_run(count: int, good: int) -> tuple[Sequence, Reconstruction]:
    poses = make_pose(np.arange(3.0)[:, None] * [0.25, 0, 0], Rotation.identity(3))
    trajectory = Trajectory(np.arange(3.0), poses)
    track = np.arange(count)
    landmarks = make_landmarks(count, good)
    tracks = Tracks(track, track, np.ones(count), np.zeros(count))

    def read_frame(index: int) -> Frame:
        raise AssertionError("the summary must not read frames")

    reconstruction = Reconstruction(trajectory, tracks, np.ones(count, bool), landmarks, np.zeros((0, 6, 6)), ())
    return Sequence("toy", SONAR, np.arange(3.0), read_frame), reconstruction


@pytest.mark.parametrize(("count", "good"), [(7, 4), (5, 0), (0, 0)])
def test_summary_states_the_counts(count: int, good: int) -> None:
    text = summarise_run(*make_run(count, good))
    for words in ("toy", "3 frames", "0.50 m", f"{count} tracks", f"{count} landmarks", f"{good} well constrained"):
        assert words in text
    assert ("0.020 m" in text) == (good > 0) and "nan" not in text


def test_summary_lists_each_diagnostic_on_one_line() -> None:
    sequence, reconstruction = make_run(3, 2)
    assert "No warnings." in summarise_run(sequence, reconstruction)
    found = Diagnostic("estimated-range-bias", "a bias of 0.02 m", severity="info")
    made = Diagnostic("mirror-ambiguity", "two\nmirror images")
    text = summarise_run(replace(sequence, diagnostics=(found,)), replace(reconstruction, diagnostics=(made,)))
    assert (
        "- **Info:** a bias of 0.02 m [estimated-range-bias]\n"
        "- **Warning:** two mirror images [mirror-ambiguity]\n" in text
    )
    assert "No warnings." not in text
