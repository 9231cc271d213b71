"""Sonar presets: parameters of commercial imaging sonars (Oculus, DIDSON, ARIS, BlueView) and of HoloOcean.

Apertures, beam counts, beam widths and frequencies are the manufacturers' values, from the sources named at each;
ranges and rates are typical ones within the manufacturers' limits, and the number of rows follows. Noise and echo
strength are the simulator's defaults unless a fit is named.
"""

import numpy as np

from asfm.datasets.aris.lenses import beam_centres_deg
from asfm.errors import AsfmError, quote
from asfm.simulation.sonars.parameters import ImagingSonar
from asfm.types import FloatArray


def _sine_spaced(outermost_deg: float, beams: int) -> tuple[float, ...]:
    """Space beams evenly in the sine of the bearing, as in the bearing tables of Oculus pings (to 0.01 deg)."""
    end = np.sin(np.deg2rad(outermost_deg))
    return _table(np.rad2deg(np.arcsin(np.linspace(-end, end, beams))))


def _didson_spaced(beams: int = 96) -> tuple[float, ...]:
    """Invert the cubic of DIDSON's lens from angle in degrees to beam number (1..96), as used in fish counting."""
    angle_deg = np.linspace(-16.0, 16.0, 6401)
    beam = 1.012 * (0.0030 * angle_deg**3 - 0.0055 * angle_deg**2 + 2.6829 * angle_deg + 48.04) + 1
    return _table(np.interp(np.arange(1, beams + 1), beam, angle_deg))


def _table(bearings_deg: FloatArray) -> tuple[float, ...]:
    """Round (beams,) bearings to 1e-4 degrees."""
    return tuple(round(float(value), 4) for value in bearings_deg)


PRESETS: dict[str, ImagingSonar] = {
    # Source: Blueprint Subsea, "Oculus M-Series" data sheet, M750d at 1.2 MHz: 70 x 12 deg, 0.6 deg, 0.1 to 40 m, up to
    # 40 Hz. It sends 256 beams by default, 512 on request. Suits boulders and piles at 2 to 6 m.
    "oculus_m750d_high": ImagingSonar(
        name="Oculus M750d 1.2 MHz",
        range_min=0.5,
        range_max=8.0,
        range_bins=600,
        azimuth=70.0,
        azimuth_bins=256,
        bearings_deg=_sine_spaced(35.0, 256),
        elevation=12.0,
        beam_width_deg=0.6,
        rate_hz=5.0,
    ),
    # Source: the same sheet, M750d at 750 kHz: 130 x 20 deg, 1 deg, 0.1 to 120 m. A wide view for navigation.
    "oculus_m750d_low": ImagingSonar(
        name="Oculus M750d 750 kHz",
        range_min=0.5,
        range_max=12.0,
        range_bins=600,
        azimuth=130.0,
        azimuth_bins=256,
        bearings_deg=_sine_spaced(65.0, 256),
        elevation=20.0,
        beam_width_deg=1.0,
        azimuth_edge_db=-8.0,
        rate_hz=5.0,
    ),
    # Source: the same sheet, M1200d at 2.1 MHz: 60 x 12 deg, 0.4 deg, 512 beams, 0.1 to 10 m, up to 40 Hz. Close
    # inspection. The noise's growth with range is that of recordings in a test tank.
    "oculus_m1200d_high": ImagingSonar(
        name="Oculus M1200d 2.1 MHz",
        range_min=0.2,
        range_max=5.0,
        range_bins=800,
        azimuth=60.0,
        azimuth_bins=512,
        bearings_deg=_sine_spaced(30.0, 512),
        elevation=12.0,
        elevation_bins=320,
        beam_width_deg=0.4,
        add_sigma=0.06,
        noise_range_exponent=0.8,
        rate_hz=10.0,
    ),
    # Source: the same sheet, M1200d at 1.2 MHz: 130 x 20 deg, 0.6 deg, 512 beams, 0.1 to 40 m.
    "oculus_m1200d_low": ImagingSonar(
        name="Oculus M1200d 1.2 MHz",
        range_min=0.3,
        range_max=10.0,
        range_bins=700,
        azimuth=130.0,
        azimuth_bins=512,
        bearings_deg=_sine_spaced(65.0, 512),
        elevation=20.0,
        elevation_bins=320,
        beam_width_deg=0.6,
        azimuth_edge_db=-8.0,
        rate_hz=10.0,
    ),
    # Sources: Sound Metrics, "DIDSON 300 m" specification and "SONAR 101: DIDSON resolution", identification mode at
    # 1.8 MHz: 29 x 14 deg, 96 beams of 0.3 deg through an acoustic lens, 512 rows, 4 to 21 Hz. A window of 9 m from
    # 2.25 m. The noise is what tools/calibration/fit_noise.py finds in 116 recorded pings of empty water with those
    # settings.
    "didson": ImagingSonar(
        name="DIDSON 300 m 1.8 MHz",
        range_min=2.25,
        range_max=11.25,
        range_bins=512,
        azimuth=29.0,
        azimuth_bins=96,
        bearings_deg=_didson_spaced(),
        elevation=14.0,
        beam_width_deg=0.3,
        independent_beams=True,
        side_lobe_db=-26.0,
        add_sigma=0.0320,
        near_sigma=0.0688,
        near_exponent=1.21,
        threshold=0.0478,
        azimuth_edge_db=-14.5,
        rate_hz=5.0,
    ),
    # Sources: Sound Metrics, "ARIS Explorer 3000" data sheet, identification mode at 3 MHz: 30 x 14 deg, 128 beams
    # every 0.25 deg through an acoustic lens, 0.7 to 5 m, up to 15 Hz; and its table of beam centres for that lens.
    "aris_3000": ImagingSonar(
        name="ARIS Explorer 3000 3 MHz",
        range_min=0.7,
        range_max=5.0,
        range_bins=860,
        azimuth=30.0,
        azimuth_bins=128,
        bearings_deg=_table(beam_centres_deg(128, telephoto=False)),
        elevation=14.0,
        beam_width_deg=0.25,
        independent_beams=True,
        rate_hz=8.0,
    ),
    # Source: Teledyne BlueView, "P900 Series 2D Imaging Sonar" data sheet, P900-130 at 900 kHz: 130 x 20 deg, 768 beams
    # of 1 deg every 0.18 deg, rows of 2.54 cm, 2 to 60 m, up to 25 Hz. The P900-45 is its middle 45 deg.
    "blueview_p900": ImagingSonar(
        name="BlueView P900-130",
        range_min=0.5,
        range_max=15.5,
        range_bins=590,
        azimuth=130.0,
        azimuth_bins=768,
        elevation=20.0,
        elevation_bins=240,
        beam_width_deg=1.0,
        azimuth_edge_db=-8.0,
        rate_hz=5.0,
    ),
    # Source: HoloOcean's documentation of ImagingSonar, without a configuration: even beams, no noise.
    "holoocean": ImagingSonar(
        name="HoloOcean ImagingSonar",
        range_min=0.1,
        range_max=10.0,
        range_bins=512,
        azimuth=120.0,
        azimuth_bins=512,
        elevation=20.0,
        elevation_bins=320,
        independent_beams=True,
        add_sigma=0.0,
        mult_sigma=0.0,
        rate_hz=5.0,
    ),
}


def find_preset(name: str) -> ImagingSonar:
    """Return a sonar by the name of its preset.

    Raises:
        AsfmError: there is no such preset; the message lists the known ones.
    """
    if name not in PRESETS:
        raise AsfmError(
            f"unknown sonar preset {quote(name)}; known: {', '.join(PRESETS)}, or a HoloOcean scenario (.json)"
        )
    return PRESETS[name]
