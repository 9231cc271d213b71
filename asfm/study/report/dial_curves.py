"""Curves of a study: pose error over each dial of the controlled corruption, with bands over the seeds."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from asfm.study.report.figure_style import LINES, MARKERS, MODES, Figure, add_legend, colour_of, make_axes
from asfm.study.report.hover_titles import title_points
from asfm.study.report.statistics import Interval, describe_sample, seed_interval
from asfm.study.report.summary_table import DIALS
from asfm.study.results_table import Row

MAX_POINTS = 8
"""Most real matchers and filter chains with a point each; beyond, the filter chains of a matcher share one."""
DIAL_NAMES = {
    "wrong_share": "share of wrong matches",
    "wrong_kind": "kind of wrong matches",
    "stated_range_noise_bins": "noise in range (bins)",
    "stated_bearing_noise_beams": "noise in bearing (beams)",
    "noise_kind": "kind of noise",
    "stated_recall": "recall",
    "stated_track_length": "longest track (frames)",
}


def draw_other_kind(corrupted: Sequence[Row], real: Sequence[Row], kind: str) -> Figure | None:
    """Draw the curve over the share of wrong matches of another kind than the first.

    Args:
        corrupted: cells of true matches with corruption.
        real: cells of real matchers.
        kind: of the wrong matches.
    """
    clean = [{**row, "wrong_kind": kind} for row in corrupted if not row["wrong_share"]]
    figure = draw_dial([*clean, *(row for row in corrupted if row["wrong_kind"] == kind)], real, "wrong_share")
    if figure is None:
        return None
    return replace(figure, name=f"{figure.name}_{kind.replace('-', '_')}", title=f"{figure.title}, {kind}")


def draw_dial(corrupted: Sequence[Row], real: Sequence[Row], dial: str) -> Figure | None:
    """Draw ATE and ATE / bound over one dial of the corruption, the other dials at their first value.

    Args:
        corrupted: cells of true matches with corruption.
        real: cells of real matchers, which are added over the share of wrong matches.
        dial: one of DIALS.

    Returns:
        The figure; None where the dial has one value only.
    """
    first = {name: corrupted[0][name] for name in DIALS} if corrupted else {}
    chosen = [row for row in corrupted if all(row[name] == first[name] for name in DIALS if name != dial)]
    values = list(dict.fromkeys(row[dial] for row in chosen))
    if len(values) < 2:
        return None
    place = _place_values(values)
    drawing, axes = make_axes(4.6, 2)
    for axis, (column, label) in zip(axes, (("ate_m", "ATE (m)"), ("ate_over_bound", "ATE / bound")), strict=True):
        for number, mode in enumerate(MODES):
            own = [row for row in chosen if row["mode"] == mode]
            found = [
                (place[value], seed_interval([row for row in own if row[dial] == value], column)) for value in values
            ]
            _draw_band(axis, sorted((x, one) for x, one in found if one is not None), mode, number)
        if dial == "wrong_share":
            _add_real_matchers(axis, real, column)
        axis.set_ylabel(label)
        axis.set_ylim(0, _find_top(axis))
    _label_values(axes[-1], dial, place)
    add_legend(drawing, axes[0])
    title = f"Pose error over the {DIAL_NAMES[dial]}"
    return Figure(
        f"dial_{dial}", title, f"{_describe(dial, first, _has_many(real))} {describe_sample(chosen)}", drawing
    )


def _label_values(axis: Any, dial: str, place: dict[Any, float]) -> None:
    """Name a dial and its values below an axis."""
    from matplotlib.ticker import MaxNLocator

    axis.set_xlabel(DIAL_NAMES[dial])
    axis.xaxis.set_major_locator(MaxNLocator(5))
    if any(isinstance(value, str) or value is None for value in place):
        axis.set_xticks(list(place.values()), ["no limit" if value is None else f"{value}" for value in place])


def _describe(dial: str, first: dict[str, Any], many: bool) -> str:
    """Say what the curve over a dial shows, and the ``first`` values of the dials, which the others have."""
    others = ", ".join(f"{DIAL_NAMES[name]} {_show(value)}" for name, value in first.items() if name != dial)
    text = (
        f"Pose error of true matches over the {DIAL_NAMES[dial]}; the other dials are at their first value ({others}). "
        "Lines are means over sequences and seeds, bands 95 % intervals of the mean over seeds (Student's t; a seed's "
        "value is its mean over the sequences); the axis cuts off wide ones. The bound is the error of the same "
        "observations at ideal places with true associations, computed for every cell."
    )
    if dial == "wrong_share":
        over = (
            "the cells of a matcher and mode, whatever the filters"
            if many
            else "the cells of a matcher, filters and mode"
        )
        text += f" Points are real matchers, at one minus their precision: means over {over}."
    return text


def _draw_band(axis: Any, curve: Sequence[tuple[float, Interval]], mode: str, number: int) -> None:
    if not curve:
        return
    x, colour = [place for place, _ in curve], colour_of(number)
    means = [one.mean for _, one in curve]
    (line,) = axis.plot(x, means, LINES[mode], color=colour, marker=MARKERS[mode], ms=4, label=MODES[mode])
    values = [f"mean {one.mean:.3g}\n95 %: {one.low:.3g} to {one.high:.3g}" for _, one in curve]
    title_points(line, [f"{MODES[mode]}\n{text}" for text in values])
    axis.fill_between(x, [one.low for _, one in curve], [one.high for _, one in curve], color=colour, alpha=0.18, lw=0)


def _find_top(axis: Any) -> float | None:
    """Return the top of an axis that shows all means and points, but not all of an interval over a few seeds."""
    heights = [value for line in axis.lines for value in line.get_ydata()]
    heights += [value for points in axis.collections for _, value in points.get_offsets()]
    return 2.2 * max(heights) if heights and max(heights) > 0 else None


def _add_real_matchers(axis: Any, rows: Sequence[Row], column: str) -> None:
    """Add real matchers to the curve over wrong matches, in the colours of the modes."""
    known = [row for row in rows if row["precision"] is not None and row[column] is not None]
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in known:
        groups.setdefault((_name_point(row, _has_many(rows)), row["mode"]), []).append(row)
    for (name, mode), own in groups.items():
        x, y = 1 - np.mean([row["precision"] for row in own]), np.mean([row[column] for row in own])
        style = {"color": colour_of(list(MODES).index(mode)), "marker": MARKERS[mode], "edgecolors": "black"}
        points = axis.scatter([x], [y], 20, linewidths=0.5, **style)
        title_points(points, [f"{name}, {MODES[mode]}\nprecision {1 - x:.3g}\n{column} {y:.3g}"])


def _has_many(rows: Sequence[Row]) -> bool:
    """Return whether matchers and filter chains are too many for a point each."""
    return len({(row["detector"], row["filters"]) for row in rows}) > MAX_POINTS


def _name_point(row: Row, many: bool) -> str:
    return row["detector"] if many else f"{row['detector']} {row['filters']}"


def _place_values(values: Sequence[Any]) -> dict[Any, float]:
    """Return where the values of a dial are drawn: numbers at themselves, others one beside the other."""
    if all(isinstance(value, int | float) for value in values):
        return {value: float(value) for value in values}
    return {value: float(number) for number, value in enumerate(values)}


def _show(value: Any) -> str:
    return "without limit" if value is None else f"{value}"
