"""Scale of pickled float images: nothing above 1 is cut off without a word."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from asfm.datasets import open_sequence
from asfm.datasets.holoocean.pixel_scale import Levels, choose_scale, measure_levels
from asfm.diagnostics import Diagnostic
from asfm.errors import AsfmError
from tests.datasets.holoocean_files import SHAPE, make_state, write_folder

WHERE = Path("Data")
RNG = np.random.default_rng(0)
UNIT = RNG.random(SHAPE, dtype=np.float32)
GREY = RNG.integers(0, 256, SHAPE).astype(np.float32)


def scale(*images: np.ndarray) -> tuple[float, list[str]]:
    found: list[Diagnostic] = []
    factor = choose_scale(WHERE, [measure_levels(image) for image in images], found)
    return factor, [item.code for item in found]


def test_images_in_0_to_1_are_left_alone() -> None:
    assert scale(UNIT) == scale(UNIT, np.zeros(SHAPE)) == scale() == (1.0, [])
    assert scale(np.full(SHAPE, np.nan), UNIT - 0.2) == (1.0, [])


@given(st.integers(10, 255))
def test_whole_numbers_up_to_255_are_bytes_however_dark_the_recording(highest: int) -> None:
    assert scale(np.minimum(GREY, highest), np.zeros(SHAPE)) == (1 / 255, ["scaled-images"])


def test_whole_numbers_beyond_are_16_bits() -> None:
    assert scale(GREY, 200 * GREY) == (1 / 65535, ["scaled-images"])


@given(st.floats(3.5, 1e6))
def test_other_numbers_are_scaled_by_the_highest_of_all_images(highest: float) -> None:
    factor, codes = scale(UNIT, UNIT / UNIT.max() * highest)
    assert factor * highest == pytest.approx(1, rel=1e-5) and codes == ["scaled-images"]


def test_a_few_pixels_that_noise_lifts_above_1_are_cut_with_a_word() -> None:
    noisy = UNIT.copy()
    noisy[0, 0] = 1.4
    assert scale(noisy) == (1.0, ["clipped-images"])
    assert scale(1.5 * UNIT)[1] == ["scaled-images"]


def test_decibels_are_refused() -> None:
    with pytest.raises(AsfmError, match=r"Data: expected echo amplitudes from 0 upwards, found -80 to 0: decibels\?"):
        choose_scale(WHERE, [Levels(-80.0, 0.0, 0.0, whole=False)], [])


def test_floats_of_0_to_255_keep_all_their_grey_values(tmp_path: Path) -> None:
    states = [make_state(0, ImagingSonar=GREY), make_state(1, ImagingSonar=0.5 * GREY.round(-1))]
    sequence = open_sequence(write_folder(tmp_path / "a", states))
    np.testing.assert_allclose(sequence.read_frame(0).image * 255, GREY, rtol=1e-6)
    np.testing.assert_allclose(sequence.read_frame(1).image * 255, 0.5 * GREY.round(-1), rtol=1e-6)
    assert [item.code for item in sequence.diagnostics] == ["scaled-images"]


def test_bytes_beside_floats_keep_their_own_scale(tmp_path: Path) -> None:
    states = [make_state(0, ImagingSonar=GREY.astype(np.uint8)), make_state(1, ImagingSonar=UNIT)]
    sequence = open_sequence(write_folder(tmp_path / "a", states))
    np.testing.assert_allclose(sequence.read_frame(0).image * 255, GREY, rtol=1e-6)
    np.testing.assert_array_equal(sequence.read_frame(1).image, UNIT)
