"""Plausible mistakes in odometry, depth, attitude, clocks and geometry: no wrong result is silent.

Two simulated sequences of tracks, without images, in every mode of the sensors. ``python -m tools.benchmark mistakes``
does the same with images, and makes mistakes in these too.
"""

from functools import partial

import numpy as np
import pytest

from asfm.config_file import load_config
from asfm.evaluation.trajectory import absolute_errors, align_se3
from asfm.navigation.frame_navigation import read_navigation
from asfm.pipeline.reconstruction import estimate
from asfm.pipeline.summary import summarise
from asfm.sequence import Sequence
from asfm.simulation.track_simulation import SONAR, TrackSimulation, simulate_tracks
from asfm.stages import StageClock
from asfm.types import IntArray, Keypoints, Matches
from tests.worlds import make_keypoints
from tools.benchmark import mistake_runs
from tools.benchmark.mistake_runs import SENSOR_MODES, Outcome, compare_mistakes, tabulate_cells
from tools.benchmark.mistakes import MISTAKES

FRAMES, GAPS = 24, (1, 2, 4)
LEFT_OUT = {
    "images mirrored",
    "far range in row 0",
    "near range -0.3 m",
    "mounting yaw +5 deg",
    "mounting pitch -5 deg",
}
"""The first two show in images only; the others cost next to nothing in these sequences, and take time."""
OF_TRACKS = tuple(
    mistake
    for mistake in MISTAKES
    if (mistake.about_geometry or mistake.wrong != "images") and mistake.name not in LEFT_OUT
)
KNOWN_LIMITS = {"lever arm 0.5 m off"}
"""Silent in a short sequence with odometry only: 1.52 times the error of the odometry alone, where 1.5 is the limit."""


def observe(simulation: TrackSimulation, sequence: Sequence) -> tuple[list[Keypoints], list[Matches]]:
    """Return the observations as keypoints of the sonar as it is stated, and their true matches."""
    tracks, sonar = simulation.tracks, sequence.sonar
    rows, columns = SONAR.row_at_range(tracks.range_m), SONAR.column_at_bearing(tracks.bearing_rad)
    in_frame = tracks.by_frame(FRAMES)
    keypoints = [
        make_keypoints(sonar.range_at_row(rows[i]), sonar.bearing_at_column(columns[i]), sonar=sonar) for i in in_frame
    ]
    track = [tracks.track[i] for i in in_frame]
    return keypoints, [match(track, b - gap, b) for gap in GAPS for b in range(gap, FRAMES)]


def match(track: list[IntArray], a: int, b: int) -> Matches:
    _, of_a, of_b = np.intersect1d(track[a], track[b], return_indices=True)
    return Matches(a, b, np.stack([of_a, of_b], axis=1), np.zeros(len(of_a)))


def measure(simulation: TrackSimulation, sequence: Sequence, mode: str) -> Outcome:
    config, clock = load_config(None, SENSOR_MODES[mode]), StageClock()
    keypoints, matches = observe(simulation, sequence)
    navigation = read_navigation(sequence, config.backend)
    found = estimate(sequence, navigation, keypoints, matches, config, clock, may_add_matches=False)
    result = summarise(found[0], found[1], config, clock, found[2])
    assert sequence.groundtruth is not None
    poses, truth = result.trajectory.world_from_vehicle, sequence.groundtruth.world_from_vehicle
    ate_m = float(np.sqrt(np.mean(absolute_errors(align_se3(poses, truth) @ poses, truth)[0] ** 2)))
    return Outcome(ate_m, frozenset(item.code for item in result.diagnostics if item.severity != "info"))


@pytest.mark.parametrize(("motion", "mode"), [("transect", "all sensors"), ("orbit", "odometry")])
def test_no_mistake_is_wrong_without_a_word(motion: str, mode: str, monkeypatch: pytest.MonkeyPatch) -> None:
    simulation = simulate_tracks(FRAMES, 20, (6, 16), motion, 1.0, True, 1)
    monkeypatch.setattr(mistake_runs, "measure", partial(measure, simulation))
    cells = list(compare_mistakes(simulation.sequence, (mode,), OF_TRACKS))
    assert len(cells) >= 20
    silent = [cell for cell in cells if cell.silent_and_wrong and cell.mistake not in KNOWN_LIMITS]
    assert not silent, "\n".join(tabulate_cells(motion, silent))
