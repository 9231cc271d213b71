"""Law of the pose error: coefficients of made-up studies are recovered, and scenes it does not hold for are named."""

import numpy as np
import pytest

from asfm.study.report.error_law import collect_settings, fit_law
from tests.study.report.rows import make_row, make_rows


def test_the_law_of_a_made_up_study_is_recovered() -> None:
    law = fit_law(make_rows(noise=0.01))
    assert law is not None and set(law.coefficients) == {"sonar", "all"}
    for values in law.coefficients.values():
        assert values[1] == pytest.approx(2.0, abs=0.15) and values[2] == pytest.approx(-0.3, abs=0.05)
        assert values[3:] == pytest.approx([0, 0], abs=1e-6), "what does not vary has no effect"
    assert law.median_error is not None and law.median_error < 0.03
    assert law.describe()[-1] == "no mode, scene or matcher has a median error above 25 %"
    assert "of 42 settings in scenes that were left out: ATE / bound within" in law.describe()[2]
    fitted = "fitted to wrong matches 0 to 0.3, recall 0.25 to 1, noise 0.5 to 0.5, track length 5 to 5"
    assert law.describe()[3].startswith(fitted)


def test_cells_of_different_seeds_are_one_setting() -> None:
    rows = make_rows(scenes=2, seeds=4)
    settings = collect_settings(rows)
    assert len(settings) == 2 * 2 * 7
    own = [row for row in rows if row["scene"] == "scene0" and row["mode"] == "all" and row["detector"] == "orb"]
    (setting,) = (item for item in settings if (item.scene, item.mode, item.label) == ("scene0", "all", "orb all"))
    assert setting.log_ratio == pytest.approx(np.mean([np.log(row["ate_over_bound"]) for row in own]))
    assert setting.features == pytest.approx((0.15, np.log(0.5), 0.5, np.log(5.0)))


def test_a_scene_is_predicted_without_its_own_cells() -> None:
    """A scene with three times the error is far from what the others predict, however many cells it has."""
    rows = make_rows(scenes=4, noise=0.01)
    for row in rows:
        if row["scene"] == "scene2":
            row["ate_over_bound"] *= 3
    law = fit_law(rows)
    assert law is not None
    own = np.array([setting.scene == "scene2" for setting in law.settings])
    assert np.median(law.relative_error[own]) == pytest.approx(2 / 3, abs=0.05)
    failures = [line for line in law.describe() if line.startswith("it fails")]
    assert any("for scenes: scene2 (67 %)" in line for line in failures)


def test_one_scene_is_not_cross_validated_and_few_settings_have_no_law() -> None:
    law = fit_law(make_rows(scenes=1))
    assert law is not None and law.median_error is None and np.isnan(law.predicted).all()
    assert law.describe()[-1] == "not cross-validated: that needs two scenes or more"
    assert fit_law(make_rows()[:5]) is None
    few = [row for row in make_rows() if row["mode"] == "all" or row["detector"] == "orb"]
    law = fit_law(few)
    assert law is not None and set(law.coefficients) == {"all"}, "three settings are too few for five coefficients"
    assert fit_law([make_row(ate_over_bound=1.0, precision=None) for _ in range(20)]) is None
