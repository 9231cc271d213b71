"""Correlated speckle and noise: exponential energies whose correlation between beams follows the beam pattern.

Noise, or the echo of the many scatterers in a pixel, is a complex Gaussian field filtered by the beam pattern:
neighbouring beams are correlated as far as their lobes overlap. In Oculus recordings of 512 beams the values of empty
water correlate by 0.83 to 0.87, 0.55 to 0.69 and 0.31 to 0.54 over one, two and three beams; a Gaussian lobe of the
manufacturer's 0.4 degrees gives 0.90, 0.65 and 0.37. Along ranges the recordings are nearly white.
"""

from dataclasses import dataclass

import numpy as np

from asfm.types import ImageArray, IntArray

BANK_ROWS = 2048


@dataclass(frozen=True)
class FieldBank:
    """Rows of a complex Gaussian field of unit energy, each as wide as the image."""

    field: ImageArray
    """(BANK_ROWS, 2, beams) real and imaginary parts."""
    energy: ImageArray
    """(BANK_ROWS, beams) squares of the field."""


def make_field_bank(lobe: ImageArray, rng: np.random.Generator) -> FieldBank:
    """Draw a bank of fields, once: a new field for every ping would take longer than rendering the ping.

    Args:
        lobe: (2 m + 1, beams) share of the power of each beam that is received in the beams m before to m after it.
        rng: source of the fields.
    """
    reach, beams = len(lobe) // 2, lobe.shape[1]
    white = rng.standard_normal((2, BANK_ROWS, beams), dtype=np.float32)
    field = np.zeros((2, BANK_ROWS, beams + 2 * reach), dtype=np.float32)
    energy = np.zeros(beams + 2 * reach)
    for shift, power in enumerate(lobe):
        field[..., shift : shift + beams] += np.sqrt(power).astype(np.float32) * white
        energy[shift : shift + beams] += power
    field *= np.sqrt(0.5 / np.maximum(energy, 1e-12)).astype(np.float32)
    real, imaginary = field[..., reach : reach + beams]
    return FieldBank(np.stack([real, imaginary], axis=1), real**2 + imaginary**2)


@dataclass(frozen=True)
class RowMix:
    """Random unitary rotation that mixes two rows of a bank into each of R rows of energies."""

    first: IntArray
    """(R,) row of the bank."""
    second: IntArray
    """(R,) row of the bank."""
    first_factor: ImageArray
    """(R, 1, 1) real factor of the first row."""
    second_factor_real: ImageArray
    """(R, 1, 1) real part of the factor of the second row."""
    second_factor_imag: ImageArray
    """(R, 1, 1) imaginary part of the factor of the second row."""


def draw_mix(bank: FieldBank, rows: int, rng: np.random.Generator) -> RowMix:
    """Draw the rotations of one ping, for ``rows`` rows of energies.

    Two pings share at most single rows, at other places in the image and mixed with other rows: no pattern that could
    be matched between frames.
    """
    first, second = rng.integers(0, len(bank.field), (2, rows))
    angle, phase = rng.uniform(0, 2 * np.pi, (2, rows, 1, 1))
    second_factor = np.sin(angle) * np.exp(1j * phase)
    factors = (part.astype(np.float32) for part in (np.cos(angle), second_factor.real, second_factor.imag))
    return RowMix(first, second, *factors)


def mix_energies(bank: FieldBank, mix: RowMix, rows: slice = slice(None)) -> tuple[ImageArray, ImageArray]:
    """Return rows of two independent images of exponential energies of mean 1, (R, beams) each.

    A unitary rotation of two fields preserves the sum of their energies: the second image is that sum minus the first.
    """
    first, second = mix.first[rows], mix.second[rows]
    field, added = bank.field.take(first, axis=0), bank.field.take(second, axis=0)
    field *= mix.first_factor[rows]
    field += mix.second_factor_real[rows] * added
    added *= mix.second_factor_imag[rows]
    field[:, 0] -= added[:, 1]
    field[:, 1] += added[:, 0]
    field *= field
    energy = field[:, 0] + field[:, 1]
    rest = bank.energy.take(first, axis=0)
    rest += bank.energy.take(second, axis=0)
    rest -= energy
    return energy, np.maximum(rest, 0, out=rest)
