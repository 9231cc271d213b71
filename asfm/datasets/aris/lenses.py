"""Beam bearings of ARIS sonars: polynomials of the acoustic lenses, which the recordings do not state."""

import numpy as np

from asfm.types import FloatArray

LENS_48 = (16.4325, 0.0, -3.5479, 0.9105)
LENS_96 = (16.4966, 0.0725, -3.3835, 0.8176)
LENS_3000 = (15.2465, 0.0, -0.0613, -0.0659)
LENS_TELEPHOTO = (7.6703, 0.0, -0.13, -0.0533)
LENSES = {
    (48, False): LENS_48,
    (96, False): LENS_96,
    (64, False): LENS_3000,
    (128, False): LENS_3000,
    (48, True): LENS_TELEPHOTO,
    (96, True): LENS_TELEPHOTO,
}
"""By (beams, telephoto): bearing in degrees = a u + b u^2 + c u^3 + d u^5, with u from -1 to 1 over the array.

Fitted for this project to the beam centres that Sound Metrics publishes for an average lens of each kind (tables of
2018); the fit is within 0.011 degrees of every beam. Evenly spaced beams would be wrong by up to 0.87 degrees.
"""


def beam_centres_deg(beams: int, telephoto: bool) -> FloatArray:
    """Return the bearing of each beam, (beams,) in degrees, rising: beam 0 is the right-most (starboard, negative)."""
    u = (np.arange(beams) + 0.5) / beams * 2 - 1
    linear, square, cube, fifth = LENSES[beams, telephoto]
    return np.asarray(linear * u + square * u**2 + cube * u**3 + fifth * u**5)


def beam_centres_rad(beams: int, telephoto: bool) -> FloatArray:
    """Return the bearing of each beam, (beams,) in radians, rising: beam 0 is the right-most (starboard, negative)."""
    return np.radians(beam_centres_deg(beams, telephoto))
