"""Feature noise of a sequence: estimated from a few pairs of neighbouring frames before anything is gated by it."""

from collections.abc import Iterator

import numpy as np

from asfm.config import Config, NoiseConfig
from asfm.frontend.denoising.echo_mask import detect_echo_mask
from asfm.frontend.features.keypoints import detect_keypoints
from asfm.frontend.matching.match_noise import MIN_PAIRS, estimate_match_noise
from asfm.frontend.matching.nearest import match_keypoints
from asfm.sequence import Sequence
from asfm.stages import StageClock
from asfm.types import ExternalMatches, FloatArray, Keypoints, Matches

MAX_PAIRS, FRAMES_PER_PAIR = 12, 6
"""Pairs of neighbouring frames whose features are detected for the estimate: evenly spread, one in so many frames."""
GATE_FACTOR = 2.8
"""Sigmas of the gates over the noise of a feature in near frames: errors that last along a track, and view changes."""
MIN_NOISE_PX, MAX_NOISE_PX = 0.25, 6.0
"""Bounds of the estimate, in range bins and in beams."""


def estimate_noise(
    sequence: Sequence, config: Config, clock: StageClock, external: ExternalMatches | None = None
) -> Config:
    """Return the configuration with the noise of features as the sequence shows it; it is not estimated again.

    Args:
        sequence: frames and sonar.
        config: what section ``noise`` states holds where the images do not tell.
        clock: times the stage.
        external: keypoints and matches computed elsewhere, of which all neighbouring frames are used.

    Raises:
        AsfmError: a frame cannot be read.
    """
    if not config.noise.estimated:
        return config
    with clock.stage("noise") as report:
        pairs = _match_sampled_pairs(sequence, config) if external is None else _neighbours(external)
        sigma = estimate_match_noise(pairs)
        if sigma is None:
            return config
        report.counts = {"range noise m": float(sigma[0]), "bearing noise deg": float(np.degrees(sigma[1]))}
    return config.model_copy(update={"noise": _state_noise(sigma, sequence)})


def _match_sampled_pairs(sequence: Sequence, config: Config) -> Iterator[tuple[Keypoints, Keypoints, Matches]]:
    """Detect and match the features of a few pairs of neighbouring frames."""
    last = len(sequence) - 2
    number = min(MAX_PAIRS, max(len(sequence) // FRAMES_PER_PAIR, MIN_PAIRS))
    for first in np.unique(np.linspace(0, last, number).round().astype(int)).tolist() if last >= 0 else ():
        a, b = (_detect(sequence, index, config) for index in (first, first + 1))
        index, ratio = match_keypoints(a, b, config.matching)
        yield a, b, Matches(first, first + 1, index, ratio)


def _detect(sequence: Sequence, index: int, config: Config) -> Keypoints:
    frame = sequence.read_frame(index)
    return detect_keypoints(frame, detect_echo_mask(frame, config), sequence.sonar, config)


def _neighbours(external: ExternalMatches) -> Iterator[tuple[Keypoints, Keypoints, Matches]]:
    """Return the external matches of neighbouring frames."""
    for matches in external.matches:
        if matches.frame_b == matches.frame_a + 1:
            yield external.keypoints[matches.frame_a], external.keypoints[matches.frame_b], matches


def _state_noise(sigma: FloatArray, sequence: Sequence) -> NoiseConfig:
    """Return the sigmas (2,) of range_m and bearing_rad as a section of the configuration, for gates."""
    step = np.array([sequence.sonar.range_step_m, sequence.sonar.bearing_step_rad])
    range_bins, bearing_beams = (GATE_FACTOR * np.clip(sigma / step, MIN_NOISE_PX, MAX_NOISE_PX)).tolist()
    return NoiseConfig(range_bins=range_bins, bearing_beams=bearing_beams, min_bearing_deg=0.0, estimated=False)
