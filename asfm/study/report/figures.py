"""Figures of a study: precision against ATE, matchers side by side, curves over each dial, and the law."""

from collections.abc import Sequence

import numpy as np

from asfm.study.report.dial_curves import draw_dial, draw_other_kind
from asfm.study.report.error_law import ErrorLaw
from asfm.study.report.figure_style import (
    MARKERS,
    MODES,
    Figure,
    add_legend,
    add_legend_of_colours,
    colour_of,
    make_axes,
    use_log_scale,
)
from asfm.study.report.gap_curves import draw_gaps
from asfm.study.report.hover_titles import describe_cell, title_points
from asfm.study.report.statistics import describe_sample, seed_interval
from asfm.study.report.summary_table import DIALS
from asfm.study.results_table import Row

TRUE_MATCHES = "#9a9a9a"
"""Grey of true matches of stated quality, behind the real matchers."""
ERRORS = {
    "ate_over_bound": "ATE / bound",
    "ate_over_odometry": "ATE / ATE of the odometry",
    "ate_over_path_percent": "ATE / path (%)",
}
"""Errors of poses that sequences are compared by, the most telling first."""


def draw_figures(rows: Sequence[Row], law: ErrorLaw | None) -> list[Figure]:
    """Draw all figures that the rows of a study allow.

    Args:
        rows: one a cell.
        law: fitted to them, or None.
    """
    real = [row for row in rows if row["wrong_share"] is None]
    corrupted = [row for row in rows if row["wrong_share"] is not None]
    error = next((name for name in ERRORS if any(row[name] is not None for row in rows)), None)
    figures: list[Figure | None] = []
    if error is not None:
        figures += [_draw_precision(rows, error), _draw_matchers(real, error)]
    figures += draw_gaps(real)
    figures += [draw_dial(corrupted, real, dial) for dial in DIALS]
    figures += [draw_other_kind(corrupted, real, kind) for kind in _list_other_kinds(corrupted)]
    figures += [_draw_law(law)]
    return [figure for figure in figures if figure is not None]


def _list_other_kinds(corrupted: Sequence[Row]) -> list[str]:
    """Return the kinds of wrong matches after the first."""
    return list(dict.fromkeys(row["wrong_kind"] for row in corrupted))[1:]


def _draw_precision(rows: Sequence[Row], error: str) -> Figure | None:
    """Draw one point a cell, a colour a matcher and a marker a mode."""
    quality = next((name for name in ("precision", "arc_inlier_ratio") if any(row[name] for row in rows)), None)
    known = [row for row in rows if quality is not None and row[quality] is not None and row[error]]
    if quality is None or not known:
        return None
    drawing, (axis,) = make_axes(4.2)
    names = list(dict.fromkeys(row["detector"] for row in sorted(known, key=_is_corrupted)))
    colours = {name: colour_of(number) for number, name in enumerate(names)}
    colours |= {row["detector"]: TRUE_MATCHES for row in known if _is_corrupted(row)}
    for name, mode in ((name, mode) for name in names for mode in MODES):
        own = [row for row in known if row["detector"] == name and row["mode"] == mode]
        if own:
            x, y = ([row[column] for row in own] for column in (quality, error))
            label = f"{name}, {MODES[mode]}" if len(names) * len({row["mode"] for row in known}) <= 12 else None
            style = {"color": colours[name], "marker": MARKERS[mode], "alpha": 0.6, "linewidths": 0}
            style["zorder"] = 1.5 if _is_corrupted(own[0]) else 2  # true matches lie below
            title_points(axis.scatter(x, y, 24, label=label, **style), [describe_cell(row) for row in own])
    axis.set(xlabel="precision of the matches" if quality == "precision" else "share on the elevation arc")
    axis.locator_params(axis="x", nbins=5)
    use_log_scale(axis, ERRORS[error])
    if axis.get_legend_handles_labels()[0]:
        add_legend(drawing, axis)
    else:
        add_legend_of_colours(drawing, axis, colours)
    measure = "precision" if quality == "precision" else "share of matches on their elevation arcs"
    text = (
        f"One point a cell: {measure} of all matches that passed the filters, against {ERRORS[error]} on a logarithmic "
        "scale. ATE is the RMSE after SE(3) alignment without scale; with the sonar alone, of the nearer of the run "
        "and its mirror image. Colours are matchers, markers are modes (circle: sonar alone, square: with odometry, "
        f"triangle: all sensors). {describe_sample(known)} The pointer over a point shows its cell."
    )
    return Figure("precision_against_ate", "Precision against pose error", text, drawing)


def _is_corrupted(row: Row) -> bool:
    return row["wrong_share"] is not None


def _draw_matchers(rows: Sequence[Row], error: str) -> Figure | None:
    """Draw the mean of every matcher and filter chain with its interval, a colour a mode."""
    known = [row for row in rows if row[error]]
    measured = {(row["detector"], row["filters"], row["backend"]) for row in known}
    order = dict.fromkeys((row["detector"], row["filters"], row["backend"]) for row in rows)
    names = [name for name in order if name in measured]
    if len(names) < 2:
        return None
    modes = [mode for mode in MODES if any(row["mode"] == mode for row in known)]
    drawing, (axis,) = make_axes(1.3 + (0.15 + 0.05 * len(modes)) * len(names))
    means: list[float] = []
    labelled: set[str] = set()
    for (number, name), (place, mode) in ((one, other) for one in enumerate(names) for other in enumerate(modes)):
        own = [row for row in known if (row["detector"], row["filters"], row["backend"]) == name]
        found = seed_interval([row for row in own if row["mode"] == mode], error, geometric=True)
        if found is not None:
            y = number + (place - (len(modes) - 1) / 2) * 0.22
            means.append(found.mean)
            style = {
                "fmt": MARKERS[mode],
                "color": colour_of(list(MODES).index(mode)),
                "markersize": 4,
                "elinewidth": 1.2,
            }
            spans = [[found.mean - found.low], [found.high - found.mean]]
            bar = axis.errorbar(found.mean, y, xerr=spans, label=None if mode in labelled else MODES[mode], **style)
            labelled.add(mode)
            title_points(bar[0], [f"{' '.join(name[:2])}, {MODES[mode]}\n{ERRORS[error]} {found.mean:.3g}"])
    several = len({name[2] for name in names}) > 1
    axis.set_yticks(range(len(names)), [" ".join(name if several else name[:2]) for name in names])
    axis.set_ylim(len(names) - 0.5, -0.5)
    axis.set_xlim(min(means) / 2, 2 * max(means))
    use_log_scale(axis, ERRORS[error], "x")
    add_legend(drawing, axis)
    text = (
        f"Geometric mean of {ERRORS[error]} over sequences and seeds for every matcher and filter chain. Bars are 95 % "
        "intervals of the mean over seeds (Student's t on the logarithms; a seed's value is its mean over "
        f"sequences); the axis cuts off wide ones. {describe_sample(known)}"
    )
    return Figure("matchers", "Matchers and filter chains", text, drawing)


def _draw_law(law: ErrorLaw | None) -> Figure | None:
    """Draw ATE / bound of settings as predicted from other scenes, over the measured one."""
    if law is None or law.median_error is None:
        return None
    drawing, (axis,) = make_axes(4.2)
    measured = np.exp([setting.log_ratio for setting in law.settings])
    predicted = np.exp(law.predicted)
    for number, mode in enumerate(MODES):
        own = np.array([setting.mode == mode for setting in law.settings]) & np.isfinite(predicted)
        if own.any():
            style = {"color": colour_of(number), "marker": MARKERS[mode], "alpha": 0.6, "linewidths": 0}
            points = axis.scatter(measured[own], predicted[own], 24, label=MODES[mode], **style)
            named = [setting for setting, chosen in zip(law.settings, own, strict=True) if chosen]
            title_points(points, [f"{setting.label}\n{setting.scene}, {MODES[mode]}" for setting in named])
    low = min(measured.min(), np.nanmin(predicted)) * 0.9
    high = max(measured.max(), np.nanmax(predicted)) * 1.1
    ends = np.array([low, high])
    axis.plot(ends, ends, color="black", linewidth=0.8)
    axis.fill_between(ends, 0.75 * ends, 1.25 * ends, color="black", alpha=0.08, linewidth=0)
    use_log_scale(axis, "predicted ATE / bound")
    use_log_scale(axis, "measured ATE / bound", "x")
    add_legend(drawing, axis)
    errors = " ".join(f"{line[0].upper()}{line[1:]}." for line in law.describe_errors())
    text = (
        "One point a setting (cells that differ in nothing but the seed): its ATE / bound, geometric mean over seeds, "
        "against what the law predicts from the other scenes (leave-one-scene-out cross-validation). The line is "
        f"equality, the grey band 25 % about it. {errors}"
    )
    return Figure("law", "The law of the pose error", text, drawing)
