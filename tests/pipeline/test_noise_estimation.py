"""Noise stage: the configuration's noise is replaced by that of neighbouring frames, whatever it said before."""

from dataclasses import replace

import numpy as np
import pytest

from asfm.config import Config
from asfm.pipeline import noise_estimation
from asfm.pipeline.noise_estimation import GATE_FACTOR, MAX_NOISE_PX, MIN_NOISE_PX, estimate_noise
from asfm.simulation.simulate import simulate
from asfm.stages import StageClock
from asfm.types import ExternalMatches, Frame, Keypoints, Matches
from tests.frontend.matching.test_match_noise import SIGMA, make_pair
from tests.worlds import make_vehicle_sequence, no_frame

SEQUENCE = replace(make_vehicle_sequence(), read_frame=no_frame)


def make_external(gap: int = 1, scale: float = 1.0) -> ExternalMatches:
    """Frames in pairs that show the same points; with a gap of 2 none of them are neighbours."""
    keypoints: list[Keypoints] = []
    matches: list[Matches] = []
    for seed in range(6):
        a, b, match = make_pair(seed, noise=scale * SIGMA)
        matches.append(Matches(len(keypoints), len(keypoints) + gap, match.index, match.cost))
        keypoints += [a, b] if gap == 1 else [a, a, b]
    return ExternalMatches(tuple(keypoints), tuple(matches))


@pytest.mark.parametrize("factor", [0.25, 1.0, 4.0])
def test_what_the_configuration_says_does_not_matter_where_the_images_tell(factor: float) -> None:
    stated = {"range_bins": 1.5 * factor, "bearing_beams": factor, "min_bearing_deg": 0.3 * factor}
    clock = StageClock()
    found = estimate_noise(SEQUENCE, Config.model_validate({"noise": stated}), clock, make_external())
    expected = GATE_FACTOR * SIGMA / [SEQUENCE.sonar.range_step_m, SEQUENCE.sonar.bearing_step_rad]
    np.testing.assert_allclose([found.noise.range_bins, found.noise.bearing_beams], expected, rtol=0.25)
    assert found == estimate_noise(SEQUENCE, Config(), StageClock(), make_external())
    np.testing.assert_allclose(clock.reports[0].counts["range noise m"], SIGMA[0], rtol=0.25)
    np.testing.assert_allclose(clock.reports[0].counts["bearing noise deg"], np.degrees(SIGMA[1]), rtol=0.25)


def test_the_configuration_holds_where_no_frames_are_neighbours() -> None:
    config = Config.model_validate({"noise": {"range_bins": 2.5}, "seed": 3})
    assert estimate_noise(SEQUENCE, config, StageClock(), make_external(gap=2)) == config


def test_noise_that_is_to_be_taken_as_stated_is_not_estimated() -> None:
    config, clock = Config.model_validate({"noise": {"range_bins": 2.5, "estimated": False}}), StageClock()
    assert estimate_noise(SEQUENCE, config, clock, make_external()) == config and not clock.reports
    estimated = estimate_noise(SEQUENCE, Config(), clock, make_external())
    assert estimate_noise(SEQUENCE, estimated, clock) == estimated, (
        "the images of an estimated noise are not read again"
    )


@pytest.mark.parametrize(("scale", "bound"), [(1e-4, MIN_NOISE_PX), (8.0, MAX_NOISE_PX)])
def test_the_noise_stays_within_its_bounds(scale: float, bound: float) -> None:
    noise = estimate_noise(SEQUENCE, Config(), StageClock(), make_external(scale=scale)).noise
    np.testing.assert_allclose(noise.range_bins, GATE_FACTOR * bound)


def test_rendered_frames_are_sampled_in_pairs() -> None:
    """Of a simulated sequence the estimate is near what its true elevations say: half a range bin or a little more."""
    sequence = simulate("seafloor", "oculus_m750d_low", 24, 0).sequence
    read: list[int] = []

    def read_frame(index: int) -> Frame:
        read.append(index)
        return sequence.read_frame(index)

    noise = estimate_noise(replace(sequence, read_frame=read_frame), Config(), StageClock()).noise
    assert len(read) == 8 and read[1::2] == [index + 1 for index in read[::2]]
    assert {0, 23} <= set(read)
    assert 0.35 < noise.range_bins / GATE_FACTOR < 0.9
    assert 0.2 < noise.bearing_beams / GATE_FACTOR < 0.7


@pytest.mark.parametrize("count", [1, 2])
def test_the_shortest_sequences_keep_what_is_stated(count: int) -> None:
    simulated = simulate("seafloor", "oculus_m750d_low", count, 0).sequence
    assert estimate_noise(simulated, Config(), StageClock()) == Config()


def test_the_number_of_pairs_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    firsts: list[int] = []
    a, _, match = make_pair(0)

    def detect(_: object, index: int, __: object) -> Keypoints:
        firsts.append(index)
        return a

    monkeypatch.setattr(noise_estimation, "_detect", detect)
    monkeypatch.setattr(noise_estimation, "match_keypoints", lambda *_: (match.index, match.cost))
    long = replace(SEQUENCE, timestamps_s=np.arange(1000.0))
    estimate_noise(long, Config(), StageClock())
    assert len(firsts) == 2 * noise_estimation.MAX_PAIRS and max(firsts) == 999
