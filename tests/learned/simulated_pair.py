"""A pair of simulated images with known motion, and what every learned matcher must make of it."""

from functools import cache
from importlib.util import find_spec

import numpy as np
import pytest

from asfm.evaluation.matching import MatchQuality, evaluate_pair
from asfm.evaluation.trajectory import interpolate_groundtruth
from asfm.evaluation.true_positions import find_true_positions
from asfm.geometry.poses import invert
from asfm.geometry.sonar import SonarModel
from asfm.learned.catalogue import MatchImages
from asfm.learned.weights import LIBRARIES, PACKAGES
from asfm.simulation.simulate import SimulatedSequence, simulate
from asfm.types import FloatArray, ImageArray, IntArray, Keypoints, Matches

FRAMES = (0, 3)
MIN_MATCHES = 15
MIN_PRECISION = 0.75
MISSING = [name for name in (*LIBRARIES, *PACKAGES) if find_spec(name) is None]
needs_extra = pytest.mark.skipif(bool(MISSING), reason=f"the extra 'learned' is not installed: no {MISSING}")


@cache
def simulate_pair() -> SimulatedSequence:
    return simulate("seafloor", "oculus_m750d_low", frame_count=max(FRAMES) + 1, seed=1)


def read_pair() -> tuple[ImageArray, ImageArray]:
    sequence = simulate_pair().sequence
    return sequence.read_frame(FRAMES[0]).image, sequence.read_frame(FRAMES[1]).image


def make_keypoints(xy_px: FloatArray, sonar: SonarModel) -> Keypoints:
    row_column = xy_px[:, ::-1] + 0.5
    return Keypoints(
        row_column=row_column,
        range_m=sonar.range_at_row(row_column[:, 0]),
        bearing_rad=sonar.bearing_at_column(row_column[:, 1]),
        response=np.ones(len(xy_px)),
        descriptors=np.zeros((len(xy_px), 0), dtype=np.float32),
        patches=np.zeros((0, 1, 1), dtype=np.float32),
    )


def judge(xy_a_px: FloatArray, xy_b_px: FloatArray, index: IntArray) -> MatchQuality:
    """Compare matches with the true motion and the true elevations."""
    simulated = simulate_pair()
    sequence = simulated.sequence
    a, b = FRAMES
    world_from_sonar = interpolate_groundtruth(sequence) @ sequence.vehicle_from_sonar
    truth = find_true_positions(
        make_keypoints(xy_a_px, sequence.sonar),
        simulated.read_truth(a).elevation_rad,
        invert(world_from_sonar[b]) @ world_from_sonar[a],
    )
    matches = Matches(a, b, index, np.full(len(index), 0.5))
    return evaluate_pair(truth, make_keypoints(xy_b_px, sequence.sonar), matches)


def check_matcher(match: MatchImages, with_sonar: bool) -> None:
    """Check that most matches agree with the motion and each keypoint is matched once at most."""
    sonar = simulate_pair().sequence.sonar if with_sonar else None
    xy_a_px, xy_b_px, index = match(*read_pair(), sonar=sonar)
    assert index.dtype == np.int64 and index.ndim == 2
    assert all(len(np.unique(column)) == len(index) for column in index.T)
    quality = judge(xy_a_px, xy_b_px, index)
    assert quality.matches >= MIN_MATCHES
    assert quality.precision is not None and quality.precision >= MIN_PRECISION
    wrong = judge(xy_a_px, xy_b_px, np.stack([index[:, 0], np.roll(index[:, 1], 1)], axis=1))
    assert wrong.precision is not None and wrong.precision < 0.3, "the truth cannot tell right from wrong"


def check_nothing_to_match(match: MatchImages) -> None:
    """Check that an image without echoes has no matches."""
    image = read_pair()[0][200:360, :128]
    none = np.zeros(image.shape, dtype=bool)
    xy_a_px, xy_b_px, index = match(image, image, masks=(none, ~none))
    assert len(xy_a_px) == 0 and len(xy_b_px) > 0 and index.shape == (0, 2)
