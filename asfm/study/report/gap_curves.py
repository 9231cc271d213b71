"""Curves over the frame gap: precision and localisation error of matches, with bands over the seeds."""

from collections.abc import Sequence
from typing import Any

from asfm.study.report.figure_style import Figure, add_legend, colour_of, make_axes
from asfm.study.report.hover_titles import title_points
from asfm.study.report.statistics import Interval, describe_sample, seed_interval
from asfm.study.results_table import GAPS, Row, gap_column

PANELS = {
    "precision": "precision",
    "arc_inlier_ratio": "share on the arc",
    "range_noise_bins": "range (bins)",
    "bearing_noise_beams": "bearing (beams)",
}
"""Measures and their labels; the share on the elevation arc is drawn where precision is not known."""
SHARES = ("precision", "arc_inlier_ratio")
MAX_LINES = 8
"""Most lines of one figure; beyond, each filter chain has its own."""
SHAPES = "os^vDPX*"
BAND_ALPHA = 0.08
"""Faint, as many bands overlap."""
Curve = list[tuple[int, Interval]]


def draw_gaps(rows: Sequence[Row]) -> list[Figure]:
    """Draw the measures of matches over the frame gap: one figure, or one a filter chain where there are many lines.

    Args:
        rows: cells of real matchers.
    """
    known = [row for row in rows if any(row[gap_column(name, gap)] is not None for name in PANELS for gap in GAPS)]
    names = list(dict.fromkeys((row["detector"], row["filters"]) for row in known))
    if not names:
        return []
    detectors, chains = (list(dict.fromkeys(name[number] for name in names)) for number in (0, 1))
    if len(names) <= MAX_LINES:
        labels = {name: name[0] if len(chains) == 1 else f"{name[0]}, {name[1]}" for name in names}
        return [_draw("gaps", "Error over the frame gap", known, labels, list(names))]
    figures = []
    for number, chain in enumerate(chains):
        own = [row for row in known if row["filters"] == chain]
        labels = {(name, chain): name for name in detectors if any(row["detector"] == name for row in own)}
        order = [(name, chain) for name in detectors]
        figures.append(_draw(f"gaps_{number + 1}", f"Error over the frame gap, filters {chain}", own, labels, order))
    return figures


def _draw(
    name: str,
    title: str,
    rows: Sequence[Row],
    labels: dict[tuple[str, str], str],
    order: list[tuple[str, str]],
) -> Figure:
    """Draw one line a matcher, whose place in ``order`` decides its colour and shape."""
    panels = [panel for panel in PANELS if any(row[gap_column(panel, gap)] is not None for row in rows for gap in GAPS)]
    if "precision" in panels:
        panels = [panel for panel in panels if panel != "arc_inlier_ratio"]
    drawing, axes = make_axes(1.1 + 1.45 * len(panels), len(panels))
    for axis, panel in zip(axes, panels, strict=True):
        for key, label in labels.items():
            own = [row for row in rows if (row["detector"], row["filters"]) == key]
            found = [(gap, seed_interval(own, gap_column(panel, gap))) for gap in GAPS]
            curve = [(gap, one) for gap, one in found if one is not None]
            if curve:
                _draw_line(axis, curve, label, order.index(key), PANELS[panel])
        axis.set_ylabel(PANELS[panel])
        _limit(axis, panel)
    axes[-1].set_xscale("log", base=2)
    axes[-1].set_xticks(GAPS, [f"{gap}" for gap in GAPS], minor=False)
    axes[-1].set_xlabel("frame gap")
    add_legend(drawing, axes[0])
    return Figure(name, title, _describe(rows, panels), drawing)


def _draw_line(axis: Any, curve: Curve, label: str, number: int, measure: str) -> None:
    gaps, means = [gap for gap, _ in curve], [one.mean for _, one in curve]
    style = {"color": colour_of(number), "marker": SHAPES[number % len(SHAPES)], "ms": 4, "lw": 1.3}
    (line,) = axis.plot(gaps, means, label=label, **style)
    title_points(
        line,
        [f"{label}, gap {gap}\n{measure} {one.mean:.3g}\n95 %: {one.low:.3g} to {one.high:.3g}" for gap, one in curve],
    )
    low, high = [one.low for _, one in curve], [one.high for _, one in curve]
    axis.fill_between(gaps, low, high, color=colour_of(number), alpha=BAND_ALPHA, lw=0)


def _limit(axis: Any, panel: str) -> None:
    """Show all means, but not all of an interval over a few seeds."""
    heights = [value for line in axis.lines for value in line.get_ydata()]
    if heights:
        margin = 0.4 * (max(heights) - min(heights)) + 0.05 * max(heights)
        low, high = max(0.0, min(heights) - margin), max(heights) + margin
        axis.set_ylim(low, min(high, 1.01) if panel in SHARES else high)


def _describe(rows: Sequence[Row], panels: Sequence[str]) -> str:
    text = {
        "precision": "Precision by true elevations (correct within 0.10 m and 1.5 degrees)",
        "arc_inlier_ratio": "Share of the matches within 0.02 m and 2 degrees of their elevation arc under true poses",
    }
    shares = " and ".join(text[panel] for panel in panels if panel in SHARES)
    noise = (
        ", and the standard deviation of one keypoint's position in range and bearing (that of the correct matches "
        "over the square root of 2)"
        if "range_noise_bins" in panels
        else ""
    )
    return (
        f"{shares}{noise}, of the matches of all frame pairs 1, 2, 4 and 8 frames apart after the filters. "
        f"{describe_sample(rows)} Lines are means over sequences, modes and seeds; bands are 95 % intervals of the "
        "mean over seeds (Student's t; a seed's value is the mean over its cells), and one seed has none. Sequences "
        "without matches that far apart do not count there. The axes begin near the smallest mean and cut off wide "
        "bands."
    )
