"""Colours: neighbouring numbers have different hues."""

import numpy as np

from asfm.visualization.colours import choose_hues


def test_neighbouring_numbers_have_distinct_hues() -> None:
    hues = choose_hues(np.arange(200)).astype(int)
    for step in (1, 2, 3):
        assert np.linalg.norm(hues[step:] - hues[:-step], axis=1).min() > 60
