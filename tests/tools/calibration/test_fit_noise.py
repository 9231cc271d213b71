"""Noise fit: it recovers simulated noise, and the DIDSON's shipped noise from recorded pings."""

from pathlib import Path

import numpy as np
import pytest

from asfm.simulation.acoustics.noise import add_noise
from asfm.simulation.sonars.parameters import make_sonar_model
from asfm.simulation.sonars.presets import PRESETS
from tools.calibration.fit_noise import FITTED, fit_noise, main, measure_fit, read_pings

DIDSON = PRESETS["didson"]


def test_simulated_noise_is_recovered() -> None:
    known = {"add_sigma": 0.05, "near_sigma": 0.12, "near_exponent": 0.8, "threshold": 0.03, "azimuth_edge_db": -8.0}
    sonar = DIDSON.model_copy(update=known | {"range_bins": 200})
    model = make_sonar_model(sonar)
    dark = np.zeros(model.shape, dtype=np.float32)
    pings = [np.round(255 * add_noise(dark, sonar, model, np.random.default_rng(i))) for i in range(25)]
    fit = fit_noise(np.stack(pings), DIDSON.model_copy(update={"range_bins": 200}))
    for name, value in known.items():
        assert getattr(fit.sonar, name) == pytest.approx(value, rel=0.05), name
    assert fit.distance < 0.005 and max(fit.zone_distances) < 0.01


def test_shipped_noise_is_the_fit_to_recorded_pings(shared_data: Path) -> None:
    pings = read_pings(shared_data / "didson_hull" / "open_water")
    assert len(pings) == 116
    fit = fit_noise(pings, DIDSON)
    for name in FITTED:
        assert getattr(fit.sonar, name) == pytest.approx(getattr(DIDSON, name), rel=0.01), name
    shipped = measure_fit(pings, DIDSON)
    assert shipped.distance < 0.015 and max(shipped.zone_distances) < 0.02
    # The distance discriminates: noise of one scale is far off.
    plain = DIDSON.model_copy(update={"near_sigma": 0.0, "threshold": 0.0})
    assert measure_fit(pings, plain).distance > 0.2


def test_a_folder_without_pings_is_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(tmp_path)]) == 2
    assert capsys.readouterr().out.count("\n") == 1
