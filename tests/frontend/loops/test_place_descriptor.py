"""Place descriptors: invariance to gain, speckle, yaw and forward motion, and difference between places."""

import numpy as np
import pytest

from asfm.frontend.loops.place_descriptor import (
    MAX_SHIFT,
    MIN_OVERLAP,
    RINGS,
    SECTORS,
    describe_place,
    place_similarity,
)
from asfm.geometry.sonar import SonarModel
from asfm.types import FloatArray, Frame

SHAPE = (400, 256)
SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.6, 0.6), SHAPE, 0.3)


def make_frame(seed: int, shift: tuple[int, int] = (0, 0), gain: float = 1.0, noise_seed: int = 0) -> Frame:
    """Make an image of a place under speckle; the place extends beyond the image and is shifted by rows and columns."""
    rng = np.random.default_rng(seed)
    place = np.full((3 * SHAPE[0], 3 * SHAPE[1]), 0.1)
    for row, column, size in rng.integers([0, 0, 8], [1200, 768, 40], (150, 3)).tolist():
        place[row : row + size, column : column + size] = rng.uniform(0.4, 1.0)
    top, left = SHAPE[0] - shift[0], SHAPE[1] - shift[1]
    image = place[top : top + SHAPE[0], left : left + SHAPE[1]]
    speckle = np.random.default_rng(noise_seed).rayleigh(0.8, SHAPE)
    return Frame(0, 0.0, (gain * image * speckle / 4).astype(np.float32), np.zeros(SHAPE, dtype=bool))


def similarity(a: Frame, b: Frame) -> float:
    return place_similarity(describe_place(a, SONAR), describe_place(b, SONAR))


def test_a_frame_has_similarity_one_with_itself() -> None:
    descriptor = describe_place(make_frame(1), SONAR)
    assert descriptor.shape == (RINGS, SECTORS)
    assert place_similarity(descriptor, descriptor) == pytest.approx(1.0)


@pytest.mark.parametrize("gain", [0.01, 0.2, 3.0])
def test_similarity_is_invariant_to_gain_and_speckle(gain: float) -> None:
    assert similarity(make_frame(1), make_frame(1, gain=gain, noise_seed=5)) > 0.9


@pytest.mark.parametrize("shift", [(0, 60), (0, -100), (60, 0), (-80, 40)])
def test_similarity_is_high_after_yaw_and_forward_motion(shift: tuple[int, int]) -> None:
    assert similarity(make_frame(1), make_frame(1, shift, noise_seed=3)) > 0.75


def test_other_places_are_less_similar() -> None:
    """Any other place is less similar to a frame than the same place after yaw and forward motion."""
    others = [similarity(make_frame(1), make_frame(seed)) for seed in range(2, 22)]
    assert max(others) < 0.65
    assert max(others) < similarity(make_frame(1), make_frame(1, (60, 60), noise_seed=3))


def test_similarity_is_symmetric() -> None:
    assert similarity(make_frame(1), make_frame(2)) == pytest.approx(similarity(make_frame(2), make_frame(1)), abs=1e-9)


def test_uniform_images_have_similarity_zero() -> None:
    dark = Frame(0, 0.0, np.zeros(SHAPE, dtype=np.float32), np.zeros(SHAPE, dtype=bool))
    bright = Frame(0, 0.0, np.ones(SHAPE, dtype=np.float32), np.ones(SHAPE, dtype=bool))
    for frame in (dark, bright):
        assert similarity(frame, make_frame(1)) == 0.0
        assert similarity(frame, frame) == 0.0


def test_invalid_pixels_are_ignored() -> None:
    """An overlay covers a fifth of the beams of one frame; marked as invalid it hardly changes the similarity."""
    frame = make_frame(1, noise_seed=4)
    invalid = frame.invalid.copy()
    invalid[:, :50] = True
    image: FloatArray = np.where(invalid, 1.0, frame.image)
    covered = Frame(0, 0.0, image.astype(np.float32), invalid)
    unmarked = Frame(0, 0.0, image.astype(np.float32), frame.invalid)
    assert similarity(make_frame(1), covered) > 0.85
    assert similarity(make_frame(1), unmarked) < similarity(make_frame(1), covered)


def test_a_small_image_has_a_descriptor() -> None:
    shape = (12, 8)
    sonar = SonarModel.evenly_spaced("tiny", (0.5, 10.0), (-0.6, 0.6), shape, 0.3)
    image = np.random.default_rng(0).random(shape).astype(np.float32)
    descriptor = describe_place(Frame(0, 0.0, image, np.zeros(shape, dtype=bool)), sonar)
    assert 0.0 <= place_similarity(descriptor, descriptor) <= 1.0


@pytest.mark.parametrize("decibel_span", [None, 40.0])
def test_cells_are_the_mean_roots_of_the_amplitudes_over_the_median_of_their_ring(decibel_span: float | None) -> None:
    rng = np.random.default_rng(0)
    invalid = rng.random(SHAPE) < 0.3
    invalid[:20, :8] = True
    frame = Frame(0, 0.0, rng.random(SHAPE, dtype=np.float32), invalid, decibel_span)
    root = np.where(invalid, np.nan, np.sqrt(frame.amplitude.astype(float)))
    rows, columns = SHAPE[0] // RINGS, SHAPE[1] // SECTORS
    cells = root.reshape(RINGS, rows, SECTORS, columns).transpose(0, 2, 1, 3).reshape(RINGS, SECTORS, -1)
    known = np.asarray(np.isfinite(cells).any(axis=2))
    assert not known[0, 0] and known.sum() == known.size - 1
    mean = np.array([[np.nanmean(cell) if np.isfinite(cell).any() else np.nan for cell in ring] for ring in cells])
    expected = mean - np.nanmedian(mean, axis=1, keepdims=True)
    np.testing.assert_allclose(describe_place(frame, SONAR), expected, atol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_similarity_is_the_largest_correlation_over_all_shifts_with_half_an_overlap(seed: int) -> None:
    """Descriptors with a trend, whose corners alone would correlate better."""
    rng = np.random.default_rng(seed)
    first, second = rng.normal(0.5, 1.0, (2, RINGS, SECTORS))
    first[:4, :4], second[-4:, -4:] = 5 * rng.random((4, 4)), 3.0
    second[-6:, -6:] = first[:6, :6]
    first[rng.random(first.shape) < 0.1] = np.nan
    best = 0.0
    for down in range(-MAX_SHIFT[0], MAX_SHIFT[0] + 1):
        for right in range(-MAX_SHIFT[1], MAX_SHIFT[1] + 1):
            rows = np.arange(max(0, -down), RINGS - max(0, down))
            columns = np.arange(max(0, -right), SECTORS - max(0, right))
            a, b = first[np.ix_(rows, columns)].ravel(), second[np.ix_(rows + down, columns + right)].ravel()
            both = np.isfinite(a) & np.isfinite(b)
            if both.sum() >= MIN_OVERLAP * RINGS * SECTORS:
                best = max(best, float(np.corrcoef(a[both], b[both])[0, 1]))
    assert place_similarity(first, second) == pytest.approx(best, abs=1e-9)
