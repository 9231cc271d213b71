"""Contexts: what they do not change with, and what tells two places apart."""

import numpy as np
import pytest

from asfm.frontend.loops.place_descriptor import RINGS, SECTORS, describe_place, place_similarity
from asfm.geometry.sonar import SonarModel
from asfm.types import FloatArray, Frame

SHAPE = (400, 256)
SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.6, 0.6), SHAPE, 0.3)


def draw(seed: int, shift: tuple[int, int] = (0, 0), gain: float = 1.0, noise_seed: int = 0) -> Frame:
    """Echoes of a place under speckle; the place goes on beyond the image, and may be shifted by rows and columns."""
    rng = np.random.default_rng(seed)
    place = np.full((3 * SHAPE[0], 3 * SHAPE[1]), 0.1)
    for row, column, size in rng.integers([0, 0, 8], [1200, 768, 40], (150, 3)).tolist():
        place[row : row + size, column : column + size] = rng.uniform(0.4, 1.0)
    top, left = SHAPE[0] - shift[0], SHAPE[1] - shift[1]
    image = place[top : top + SHAPE[0], left : left + SHAPE[1]]
    speckle = np.random.default_rng(noise_seed).rayleigh(0.8, SHAPE)
    return Frame(0, 0.0, (gain * image * speckle / 4).astype(np.float32), np.zeros(SHAPE, dtype=bool))


def likeness(a: Frame, b: Frame) -> float:
    return place_similarity(describe_place(a, SONAR), describe_place(b, SONAR))


def test_a_frame_is_like_itself() -> None:
    descriptor = describe_place(draw(1), SONAR)
    assert descriptor.shape == (RINGS, SECTORS)
    assert place_similarity(descriptor, descriptor) == pytest.approx(1.0)


@pytest.mark.parametrize("gain", [0.01, 0.2, 3.0])
def test_gain_and_speckle_do_not_matter(gain: float) -> None:
    assert likeness(draw(1), draw(1, gain=gain, noise_seed=5)) > 0.9


@pytest.mark.parametrize("shift", [(0, 60), (0, -100), (60, 0), (-80, 40)])
def test_turns_and_steps_ahead_are_shifts(shift: tuple[int, int]) -> None:
    assert likeness(draw(1), draw(1, shift, noise_seed=3)) > 0.75


def test_other_places_are_less_alike() -> None:
    """Every other place is less like the first than the first is like itself, turned and stepped ahead."""
    others = [likeness(draw(1), draw(seed)) for seed in range(2, 22)]
    assert max(others) < 0.65
    assert max(others) < likeness(draw(1), draw(1, (60, 60), noise_seed=3))


def test_it_does_not_matter_who_comes_first() -> None:
    assert likeness(draw(1), draw(2)) == pytest.approx(likeness(draw(2), draw(1)), abs=1e-9)


def test_nothing_is_like_nothing() -> None:
    dark = Frame(0, 0.0, np.zeros(SHAPE, dtype=np.float32), np.zeros(SHAPE, dtype=bool))
    blind = Frame(0, 0.0, np.ones(SHAPE, dtype=np.float32), np.ones(SHAPE, dtype=bool))
    for frame in (dark, blind):
        assert likeness(frame, draw(1)) == 0.0
        assert likeness(frame, frame) == 0.0


def test_what_holds_no_data_is_not_compared() -> None:
    """An overlay over a fifth of the beams of one frame: the rest still tells."""
    frame = draw(1, noise_seed=4)
    invalid = frame.invalid.copy()
    invalid[:, :50] = True
    image: FloatArray = np.where(invalid, 1.0, frame.image)
    covered = Frame(0, 0.0, image.astype(np.float32), invalid)
    assert likeness(draw(1), covered) > 0.85
    assert likeness(draw(1), Frame(0, 0.0, image.astype(np.float32), frame.invalid)) < likeness(draw(1), covered)


def test_a_small_image_has_a_context() -> None:
    shape = (12, 8)
    sonar = SonarModel.evenly_spaced("tiny", (0.5, 10.0), (-0.6, 0.6), shape, 0.3)
    image = np.random.default_rng(0).random(shape).astype(np.float32)
    descriptor = describe_place(Frame(0, 0.0, image, np.zeros(shape, dtype=bool)), sonar)
    assert 0.0 <= place_similarity(descriptor, descriptor) <= 1.0
