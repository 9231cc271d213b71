"""Bearings of the beams of ARIS lenses, against single values that the manufacturer publishes."""

import numpy as np
import pytest

from asfm.datasets.aris.lenses import beam_centres_rad


@pytest.mark.parametrize(
    ("beams", "telephoto", "known_deg"),
    [
        # Single centres that the manufacturer states for its average lens of 2018, by beam.
        (48, False, {0: -13.5735, 12: -7.5026, 23: -0.3461, 24: 0.3461, 40: 10.2824, 47: 13.5735}),
        (96, False, {0: -13.749, 28: -6.4652, 48: 0.1706, 72: 8.0193, 95: 13.8759}),
        (64, False, {0: -14.8872, 16: -7.3742, 31: -0.2389, 63: 14.8872}),
        (128, False, {0: -15.0068}),
        (48, True, {0: -7.339, 12: -3.659, 47: 7.339}),
        (96, True, {0: -7.419, 24: -3.739, 95: 7.419}),
    ],
)
def test_bearings_are_those_that_the_manufacturer_publishes(
    beams: int, telephoto: bool, known_deg: dict[int, float]
) -> None:
    centres_deg = np.degrees(beam_centres_rad(beams, telephoto))
    assert len(centres_deg) == beams and np.all(np.diff(centres_deg) > 0)
    for beam, expected_deg in known_deg.items():
        assert centres_deg[beam] == pytest.approx(expected_deg, abs=0.02)
