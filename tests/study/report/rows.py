"""Rows of made-up studies, whose law is known."""

from collections.abc import Iterator
from itertools import product
from typing import Any

import numpy as np

from asfm.study.results_table import COLUMNS, GAPS, Row, gap_column


def make_row(**values: Any) -> Row:
    """Make a row of a finished cell; columns without a value are None."""
    row: Row = dict.fromkeys(COLUMNS)
    names = {"sequence": "pier-sonar", "scene": "pier", "detector": "akaze", "filters": "all", "backend": "default"}
    return {**row, **names, "mode": "all", "seed": 0, "warnings": "", "missing": "", "seconds": 1.0, **values}


def make_rows(scenes: int = 3, seeds: int = 3, noise: float = 0.05, seed: int = 0) -> list[Row]:
    """Make the cells of corrupted and real matchers, with log(ATE / bound) = 2 x wrong - 0.3 x log recall."""
    return list(_iterate(scenes, seeds, noise, np.random.default_rng(seed)))


def _iterate(scenes: int, seeds: int, noise: float, rng: np.random.Generator) -> Iterator[Row]:
    for scene, seed, mode in product(range(scenes), range(seeds), ("sonar", "all")):
        name = f"scene{scene}"
        place = {"scene": name, "sequence": f"{name}-sonar", "mode": mode, "seed": seed}
        for wrong, recall in ((0.0, 1.0), (0.1, 1.0), (0.3, 1.0), (0.0, 0.5), (0.0, 0.25)):
            dials = {"wrong_share": wrong, "wrong_kind": "random", "stated_recall": recall, "noise_kind": "white"}
            dials |= {"stated_range_noise_bins": 0.5, "stated_bearing_noise_beams": 0.5}
            found = _measure(1 - wrong, recall, noise, rng)
            yield make_row(**place, detector="true matches", filters="none", **dials, **found)
        for detector, precision in (("akaze", 0.95), ("orb", 0.85)):
            yield make_row(
                **place, detector=detector, **_measure(precision, 0.5, noise, rng), **_measure_gaps(precision)
            )


def _measure_gaps(precision: float) -> Row:
    """Return precision that falls by 0.01 a frame, and noise that grows by 0.1 bins and 0.05 beams a frame."""
    row = {gap_column("precision", gap): precision - 0.01 * gap for gap in GAPS}
    row |= {gap_column("range_noise_bins", gap): 0.5 + 0.1 * gap for gap in GAPS}
    return row | {gap_column("bearing_noise_beams", gap): 0.4 + 0.05 * gap for gap in GAPS}


def _measure(precision: float, recall: float, noise: float, rng: np.random.Generator) -> Row:
    ratio = float(np.exp(2 * (1 - precision) - 0.3 * np.log(recall) + noise * rng.standard_normal()))
    return {
        "precision": precision,
        "recall": recall,
        "arc_inlier_ratio": precision,
        "matches": 100,
        "range_noise_bins": 0.5,
        "bearing_noise_beams": 0.5,
        "track_length": 5.0,
        "ate_m": 0.02 * ratio,
        "bound_ate_m": 0.02,
        "ate_over_bound": ratio,
        "ate_over_odometry": ratio / 4,
        "ate_over_path_percent": ratio,
    }
