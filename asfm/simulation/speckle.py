"""Random energies as beams hear them: exponential in every pixel, alike in beams that overlap.

What beams receive from noise, or from the many scatterers of a pixel, is a complex Gaussian field that has passed the
beam pattern: neighbouring beams share it as far as their lobes overlap. In Oculus recordings of 512 beams the values of
empty water correlate by 0.83 to 0.87, 0.55 to 0.69 and 0.31 to 0.54 over one, two and three beams; the Gaussian lobe of
the maker's 0.4 degrees gives 0.90, 0.65 and 0.37. Along ranges the recordings are nearly white.
"""

from dataclasses import dataclass

import numpy as np

from asfm.types import ImageArray

BANK_ROWS = 2048


@dataclass(frozen=True)
class FieldBank:
    """Rows of a complex Gaussian field of unit energy, each as wide as the image."""

    real: ImageArray
    """(BANK_ROWS, beams)"""
    imaginary: ImageArray
    """(BANK_ROWS, beams)"""
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
    real, imaginary = field[..., reach : reach + beams].copy()
    return FieldBank(real, imaginary, real**2 + imaginary**2)


def draw_energies(bank: FieldBank, rows: int, rng: np.random.Generator) -> tuple[ImageArray, ImageArray]:
    """Draw two independent (rows, beams) images of energies of mean 1.

    Each row is a random unitary rotation of two random rows of the bank into two fields, so that the second field's
    energy is what the first leaves of the two rows' energies. Two pings share at most single rows, elsewhere in the
    image and mixed with others: no pattern that a matcher could take for a thing.
    """
    one, other = rng.integers(0, len(bank.real), (2, rows))
    mix, phase = rng.uniform(0, 2 * np.pi, (2, rows, 1))
    share = np.cos(mix).astype(np.float32)
    turn = np.sin(mix) * np.exp(1j * phase)
    turn_real, turn_imaginary = turn.real.astype(np.float32), turn.imag.astype(np.float32)
    other_real, other_imaginary = bank.real[other], bank.imaginary[other]
    real = share * bank.real[one]
    real += turn_real * other_real
    real -= turn_imaginary * other_imaginary
    imaginary = share * bank.imaginary[one]
    imaginary += turn_imaginary * other_real
    imaginary += turn_real * other_imaginary
    real *= real
    imaginary *= imaginary
    real += imaginary
    rest = bank.energy[one]
    rest += bank.energy[other]
    rest -= real
    return real, np.maximum(rest, 0, out=rest)
