"""Calibration parameters: each is told apart from the others, and is examined where all sensors measure."""

import numpy as np

from asfm.backend.diagnostics.calibration_parameters import NUMBER, PARAMETERS
from asfm.backend.diagnostics.linearised_residuals import linearise_residuals
from tests.backend.diagnostics.solved import solve_vehicle
from tests.worlds import make_vehicle_sequence


def test_names_and_words_are_unique() -> None:
    assert len(NUMBER) == len(PARAMETERS) and [NUMBER[item.name] for item in PARAMETERS] == list(range(len(NUMBER)))
    words = [text for item in PARAMETERS for text in (item.positive, item.negative)]
    assert len(set(words)) == len(words) and all(
        item.prior_sigma > item.tolerance > 0 and item.unit_size > 0 for item in PARAMETERS
    )


def test_every_parameter_is_examined() -> None:
    blocks = linearise_residuals(solve_vehicle(), make_vehicle_sequence().timestamps_s)
    examined = np.sum([np.abs(block.by_parameter).sum(axis=(0, 1)) for block in blocks], axis=0)
    assert (examined > 0).all()
