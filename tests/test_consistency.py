"""Consistency: what report.json holds of it."""

import json

from asfm.consistency import CalibrationScore, Consistency, LocalFit, ResidualStatistics


def test_report_names_every_sensor_and_parameter() -> None:
    residual = ResidualStatistics("depth", 0.5, 3.0, 1.0, (2, 11), ((2, 11),))
    found = Consistency(
        (residual,), (CalibrationScore("range_scale", 0.1, 0.02, True),), 0.9, LocalFit(1.5, 0.1, True)
    ).as_dict()
    assert json.loads(json.dumps(found)) == {
        "residuals": {
            "depth": {
                "mean_square": 0.5,
                "worst_mean_square": 3.0,
                "worst_sum": 1.0,
                "worst_frames": [2, 11],
                "inconsistent": [[2, 11]],
            }
        },
        "calibration": {"range_scale": {"value": 0.1, "sigma": 0.02, "inconsistent": True}},
        "used_share": 0.9,
        "local_fit": {"ratio": 1.5, "lost_share": 0.1, "poor": True, "poor_frames": []},
    }


def test_nothing_is_consistent_by_default() -> None:
    empty = {"residuals": {}, "calibration": {}, "used_share": 1.0, "local_fit": None}
    assert Consistency().as_dict() == empty
