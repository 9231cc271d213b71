"""Parameters of the simulated sonar: HoloOcean's names and asfm's, refused values, and the pixel grid."""

from typing import Any

import numpy as np
import pytest

from asfm.errors import AsfmError
from asfm.simulation.sonars.parameters import ImagingSonar, make_sonar_model, parse_sonar


def test_both_spellings_of_a_name_are_the_same() -> None:
    expected = ImagingSonar(range_bins=64, add_sigma=0.1, multi_path=True)
    assert parse_sonar({"RangeBins": 64, "AddSigma": 0.1, "MultiPath": True}, "file") == expected
    assert parse_sonar({"range_bins": 64, "add_sigma": 0.1, "multi_path": True}, "file") == expected


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"RangeBinz": 3}, "unknown sonar parameter 'RangeBinz'; known: .*RangeBins"),
        ({"RangeBins": "64"}, "'RangeBins': expected a number, found '64'"),
        ({"Azimuth": True}, "'Azimuth': expected a number, found true"),
        ({"Azimuth": 190}, "'Azimuth': .*expected to be less than 180|'Azimuth': expected .*180.*found 190"),
        ({"RangeMin": 5, "RangeMax": 5}, "RangeMin 5.0 must be below RangeMax 5.0"),
        ({"RangeBins": 100_000, "AzimuthBins": 1_000}, "AzimuthBins 1000 x RangeBins 100000 is more than"),
        ({"bearings_deg": (-1.0, 1.0), "AzimuthBins": 3}, "bearings_deg has 2 beams, AzimuthBins is 3"),
        ({"bearings_deg": (1.0, -1.0), "AzimuthBins": 2}, "bearings_deg must rise"),
    ],
)
def test_a_fault_is_one_line_with_place_key_and_value(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(AsfmError, match=rf"^scene\.json: [^\n]*{message}") as error:
        parse_sonar(settings, "scene.json")
    assert "\n" not in str(error.value)


def test_pixel_grid_is_that_of_the_parameters() -> None:
    model = make_sonar_model(
        ImagingSonar(range_min=1, range_max=3, range_bins=4, azimuth=60, azimuth_bins=6, elevation=20)
    )
    np.testing.assert_allclose(model.range_edges_m, [1.0, 1.5, 2.0, 2.5, 3.0])
    np.testing.assert_allclose(np.degrees(model.bearing_edges_rad), np.linspace(-30, 30, 7), atol=1e-12)
    assert np.degrees(model.elevation_aperture_rad) == pytest.approx(20)


def test_uneven_beams_replace_the_azimuth() -> None:
    bearings_deg = (-20.0, -5.0, 0.0, 4.0)
    model = make_sonar_model(ImagingSonar(bearings_deg=bearings_deg, azimuth_bins=4, range_bins=8))
    np.testing.assert_allclose(np.degrees(model.bearing_rad), bearings_deg)
    assert model.shape == (8, 4)
