"""Random energies as beams hear them: exponential in every pixel, alike in beams that overlap.

What beams receive from noise, or from the many scatterers of a pixel, is a complex Gaussian field that has passed the
beam pattern: neighbouring beams share it as far as their lobes overlap. In Oculus recordings of 512 beams the values of
empty water correlate by 0.83 to 0.87, 0.55 to 0.69 and 0.31 to 0.54 over one, two and three beams; the Gaussian lobe of
the maker's 0.4 degrees gives 0.90, 0.65 and 0.37. Along ranges the recordings are nearly white.
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
    """Draw a bank once, since a field a ping would cost more than all the rest of the ping.

    Args:
        lobe: (2 m + 1, beams) share of the power of each beam that is heard in the beams m before to m after it.
        rng: source of the bank.
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
    """How each of R rows of energies is made of two rows of a bank: a random unitary rotation."""

    one: IntArray
    """(R,) row of the bank."""
    other: IntArray
    """(R,) row of the bank."""
    share: ImageArray
    """(R, 1, 1) factor of the one."""
    turn_real: ImageArray
    """(R, 1, 1) real part of the factor of the other."""
    turn_imaginary: ImageArray
    """(R, 1, 1) imaginary part of the factor of the other."""


def draw_mix(bank: FieldBank, rows: int, rng: np.random.Generator) -> RowMix:
    """Draw what makes a ping's noise its own.

    Two pings share at most single rows, elsewhere in the image and mixed with others: no pattern that a matcher could
    take for a thing.
    """
    one, other = rng.integers(0, len(bank.field), (2, rows))
    mix, phase = rng.uniform(0, 2 * np.pi, (2, rows, 1, 1))
    turn = np.sin(mix) * np.exp(1j * phase)
    factors = (part.astype(np.float32) for part in (np.cos(mix), turn.real, turn.imag))
    return RowMix(one, other, *factors)


def mix_energies(bank: FieldBank, mix: RowMix, rows: slice = slice(None)) -> tuple[ImageArray, ImageArray]:
    """Give ``rows`` of two independent images of energies of mean 1.

    Each rotation makes two fields of two, so that the second field's energy is what the first leaves of the two rows'
    energies.
    """
    one, other = mix.one[rows], mix.other[rows]
    field, added = bank.field.take(one, axis=0), bank.field.take(other, axis=0)
    field *= mix.share[rows]
    field += mix.turn_real[rows] * added
    added *= mix.turn_imaginary[rows]
    field[:, 0] -= added[:, 1]
    field[:, 1] += added[:, 0]
    field *= field
    energy = field[:, 0] + field[:, 1]
    rest = bank.energy.take(one, axis=0)
    rest += bank.energy.take(other, axis=0)
    rest -= energy
    return energy, np.maximum(rest, 0, out=rest)
