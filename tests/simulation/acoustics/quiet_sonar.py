"""A sonar without noise, side lobes or cross-talk, for tests of echoes."""

from asfm.simulation.sonars.parameters import ImagingSonar

QUIET_SONAR = ImagingSonar(
    range_min=0.5,
    range_max=8.0,
    range_bins=300,
    azimuth=60,
    azimuth_bins=96,
    elevation=20,
    elevation_bins=300,
    add_sigma=0.0,
    mult_sigma=0.0,
    gain=1.0,
    multi_path_db=-6.0,
    side_lobe_db=-90.0,
    cross_talk_db=-90.0,
)
