"""Correlated energies: exponential of mean 1, correlated between beams as the lobes overlap, else independent."""

import numpy as np
import pytest
from scipy import stats

from asfm.simulation.acoustics.correlated_fields import FieldBank, draw_mix, make_field_bank, mix_energies
from asfm.types import ImageArray

BEAMS, ROWS = 60, 1500
WEIGHTS = np.array([0.2, 0.6, 0.2])
"""Power received in the beams before, at and after each one."""


@pytest.fixture(scope="module")
def bank() -> FieldBank:
    return make_field_bank(np.tile(WEIGHTS[:, None], (1, BEAMS)).astype(np.float32), np.random.default_rng(0))


def _draw(bank: FieldBank, seed: int = 1) -> tuple[ImageArray, ImageArray]:
    return mix_energies(bank, draw_mix(bank, ROWS, np.random.default_rng(seed)))


def _correlation(one: ImageArray, other: ImageArray) -> float:
    return float(np.corrcoef(one.ravel(), other.ravel())[0, 1])


def test_energies_of_one_beam_are_exponential_with_mean_1(bank: FieldBank) -> None:
    for energy in _draw(bank):
        assert energy.shape == (ROWS, BEAMS) and energy.min() >= 0
        assert energy.mean() == pytest.approx(1, abs=0.03)
        for beam in (0, BEAMS // 2, BEAMS - 1):
            assert stats.kstest(energy[:, beam], stats.expon.cdf).pvalue > 0.001


def test_beams_are_correlated_as_their_lobes_overlap(bank: FieldBank) -> None:
    """The correlation of energies is the square of that of the fields: sum(sqrt(w_i w_i+d)) over sum(w)."""
    energy, _ = _draw(bank)
    amplitude = np.sqrt(WEIGHTS)
    for away in range(1, 5):
        overlap = float(np.correlate(np.pad(amplitude, 5), np.pad(amplitude, 5), "full")[len(WEIGHTS) + 9 + away])
        assert _correlation(energy[:, away:], energy[:, :-away]) == pytest.approx(overlap**2, abs=0.03)


def test_images_rows_and_pings_are_independent(bank: FieldBank) -> None:
    energy, rest = _draw(bank)
    again, _ = _draw(bank, seed=2)
    assert abs(_correlation(energy, rest)) < 0.03 and abs(_correlation(energy, again)) < 0.03
    assert abs(_correlation(energy[1:], energy[:-1])) < 0.03


def test_the_rotation_preserves_the_sum_of_the_energies(bank: FieldBank) -> None:
    mix = draw_mix(bank, ROWS, np.random.default_rng(1))
    energy, rest = mix_energies(bank, mix)
    np.testing.assert_allclose(energy + rest, bank.energy[mix.first] + bank.energy[mix.second], atol=1e-4)


def test_selected_rows_are_those_of_the_whole_image(bank: FieldBank) -> None:
    mix = draw_mix(bank, ROWS, np.random.default_rng(1))
    for whole, part in zip(mix_energies(bank, mix), mix_energies(bank, mix, slice(100, 120)), strict=True):
        np.testing.assert_array_equal(part, whole[100:120])
