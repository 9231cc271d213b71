"""Sonars that can be asked for by name."""

from asfm.errors import AsfmError
from asfm.simulation.sensor import ImagingSonar

PRESETS: dict[str, ImagingSonar] = {
    "oculus_m750d_high": ImagingSonar(
        # Blueprint Subsea, M750d data sheet: 1.2 MHz, 70 x 12 deg, 0.6 deg angular resolution; half its 512 beams.
        name="Oculus M750d 1.2 MHz",
        range_min=0.5,
        range_max=8.0,
        range_bins=600,
        azimuth=70.0,
        azimuth_bins=256,
        elevation=12.0,
        beam_width_deg=0.6,
    ),
}


def find_preset(name: str) -> ImagingSonar:
    """Give a sonar by name.

    Raises:
        AsfmError: no such preset; the message lists those there are.
    """
    if name not in PRESETS:
        raise AsfmError(f"unknown sonar preset {name!r}; known: {', '.join(PRESETS)}")
    return PRESETS[name]
