"""Law of the pose error: ATE / bound as a function of precision, recall, noise and track length of the matches.

Of each mode, log(ATE / bound) is a linear function of the share of wrong matches, the logarithms of recall and of the
track length, and the noise in pixels, fitted by least squares with a weak penalty (ridge). ATE / bound of a setting is
the geometric mean over its seeds: a single run's is as much luck as quality. The error of prediction is that of scenes
which were left out of the fit (leave-one-scene-out cross-validation).
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from asfm.study.report.summary_table import DIALS, GROUP, geometric_mean_of, mean_of
from asfm.study.results_table import Row
from asfm.types import FloatArray

FEATURES = ("wrong matches", "log recall", "noise", "log track length")
MEASURES = ("precision", "recall", "range_noise_bins", "bearing_noise_beams", "track_length", "ate_over_bound")
RIDGE = 1e-2
"""Penalty on the standardised coefficients, a share of the number of settings."""
MIN_SETTINGS = 7
"""Fewest settings of a mode; five coefficients are fitted to them."""
FAILURE = 0.25
"""Median relative error beyond which the law is said to fail."""
MAX_LISTED = 5


@dataclass(frozen=True)
class Setting:
    """Cells that differ in nothing but the seed."""

    scene: str
    mode: str
    label: str
    features: tuple[float, ...]
    """Values of FEATURES, means over the seeds."""
    log_ratio: float
    """Mean of log(ATE / bound)."""


@dataclass(frozen=True)
class ErrorLaw:
    """The fitted law and its errors."""

    settings: tuple[Setting, ...]
    coefficients: dict[str, FloatArray]
    """By mode: (5,) the constant, then those of FEATURES."""
    predicted: FloatArray
    """(S,) log(ATE / bound) of every setting, predicted from the other scenes; NaN where there are none."""

    @property
    def relative_error(self) -> FloatArray:
        """(S,) |predicted / measured - 1| of settings of scenes that were left out; NaN where there are none."""
        measured = np.array([setting.log_ratio for setting in self.settings])
        return np.asarray(np.abs(np.exp(self.predicted - measured) - 1))

    @property
    def median_error(self) -> float | None:
        """Median of the relative errors; None with one scene, for which nothing can be left out."""
        return _median(self.relative_error)

    def describe(self) -> list[str]:
        """Return the law, its cross-validated error and where it fails, a line each."""
        lines = []
        for mode, values in self.coefficients.items():
            terms = [f"{value:+.2f} x {name}" for value, name in zip(values[1:], FEATURES, strict=True)]
            lines.append(f"{mode}: log(ATE / bound) = {values[0]:.2f} {' '.join(terms)}")
        return [*lines, *self.describe_errors()]

    def describe_errors(self) -> list[str]:
        """Return the cross-validated error, what the law was fitted to and where it fails, a line each."""
        if self.median_error is None:
            return [self._describe_ranges(), "not cross-validated: that needs two scenes or more"]
        count = int(np.isfinite(self.predicted).sum())
        error = 100 * self.median_error
        within = f"of {count} settings in scenes that were left out: ATE / bound within {error:.0f} % in the median"
        return [within, self._describe_ranges(), *self._list_failures()]

    def _describe_ranges(self) -> str:
        """Say which matches the law was fitted to."""
        values = np.array([setting.features for setting in self.settings])
        values[:, [1, 3]] = np.exp(values[:, [1, 3]])
        low, high = values.min(axis=0), values.max(axis=0)
        names = ("wrong matches", "recall", "noise", "track length")
        spans = [f"{name} {a:.2g} to {b:.2g}" for name, a, b in zip(names, low, high, strict=True)]
        return f"fitted to {', '.join(spans)}: it says nothing of matches outside of these"

    def _list_failures(self) -> list[str]:
        """Name the modes, scenes and matchers whose median error is large, and the worst settings."""
        error, lines = self.relative_error, []
        for what in ("mode", "scene", "label"):
            names = dict.fromkeys(getattr(setting, what) for setting in self.settings)
            found = [(_median(error[[getattr(item, what) == name for item in self.settings]]), name) for name in names]
            bad = sorted(
                ((value, name) for value, name in found if value is not None and value > FAILURE), reverse=True
            )
            listed = [f"{name} ({100 * value:.0f} %)" for value, name in bad[:MAX_LISTED]]
            more = f" and {len(bad) - MAX_LISTED} more" if len(bad) > MAX_LISTED else ""
            if listed:
                title = {"mode": "modes", "scene": "scenes", "label": "matchers"}[what]
                lines.append(
                    f"it fails (median error above {100 * FAILURE:.0f} %) for {title}: {', '.join(listed)}{more}"
                )
        return lines or [f"no mode, scene or matcher has a median error above {100 * FAILURE:.0f} %"]


def fit_law(rows: Sequence[Row]) -> ErrorLaw | None:
    """Fit the law to the cells of a study; modes with fewer than MIN_SETTINGS settings are left out.

    Returns:
        The law; None where no mode has enough of them with all that it needs.
    """
    settings = collect_settings(rows)
    counts = Counter(setting.mode for setting in settings)
    settings = [setting for setting in settings if counts[setting.mode] >= MIN_SETTINGS]
    if not settings:
        return None
    coefficients, predicted = {}, np.full(len(settings), np.nan)
    for mode in dict.fromkeys(setting.mode for setting in settings):
        own = [number for number, setting in enumerate(settings) if setting.mode == mode]
        coefficients[mode] = _fit([settings[number] for number in own])
        for number in own:
            others = [settings[other] for other in own if settings[other].scene != settings[number].scene]
            if len(others) >= MIN_SETTINGS:
                predicted[number] = _design([settings[number]])[0] @ _fit(others)
    return ErrorLaw(tuple(settings), coefficients, predicted)


def collect_settings(rows: Sequence[Row]) -> list[Setting]:
    """Join the cells that differ in nothing but the seed; those without all measures are left out."""
    groups: dict[tuple[object, ...], list[Row]] = {}
    for row in rows:
        if all(row[name] for name in MEASURES if not name.endswith(("bins", "beams"))):
            groups.setdefault(tuple(row[name] for name in ("sequence", *GROUP, *DIALS)), []).append(row)
    return [_make_setting(members) for members in groups.values()]


def _make_setting(rows: list[Row]) -> Setting:
    means = {name: mean_of(rows, name) or 0.0 for name in MEASURES}
    noise = float(np.hypot(means["range_noise_bins"], means["bearing_noise_beams"]) / np.sqrt(2))
    features = (1 - means["precision"], float(np.log(means["recall"])), noise, float(np.log(means["track_length"])))
    ratio = geometric_mean_of(rows, "ate_over_bound")
    assert ratio is not None
    return Setting(rows[0]["scene"], rows[0]["mode"], _label(rows[0]), features, float(np.log(ratio)))


def _label(row: Row) -> str:
    if row["wrong_share"] is None:
        return f"{row['detector']} {row['filters']}"
    dials = f"{row['wrong_share']:g} {row['wrong_kind']} wrong, recall {row['stated_recall']:g}"
    noise = f"noise {row['stated_range_noise_bins']:g}/{row['stated_bearing_noise_beams']:g} {row['noise_kind']}"
    length = "" if row["stated_track_length"] is None else f", tracks of {row['stated_track_length']}"
    return f"{dials}, {noise}{length}"


def _design(settings: Sequence[Setting]) -> FloatArray:
    return np.array([[1.0, *setting.features] for setting in settings])


def _fit(settings: Sequence[Setting]) -> FloatArray:
    """Fit the (5,) coefficients; the features are standardised for the penalty, and the constant has none."""
    design, target = _design(settings), np.array([setting.log_ratio for setting in settings])
    mean, scale = design[:, 1:].mean(axis=0), np.maximum(design[:, 1:].std(axis=0), 1e-6)
    standard = (design[:, 1:] - mean) / scale
    penalty = RIDGE * len(target) * np.eye(standard.shape[1])
    slope = np.linalg.solve(standard.T @ standard + penalty, standard.T @ (target - target.mean())) / scale
    return np.concatenate([[target.mean() - mean @ slope], slope])


def _median(values: FloatArray) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else None
