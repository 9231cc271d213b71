"""Style of a study's figures: size, colours, markers, logarithmic axes and legends."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

WIDTH_IN = 4.4
"""Width of a figure: its letters are legible where a page is 400 pixels wide."""
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#8c6d31")
"""Okabe and Ito's palette, told apart also by the colour-blind; brown in place of its yellow."""
MARKERS = {"sonar": "o", "odometry": "s", "all": "^"}
LINES = {"sonar": "-", "odometry": "--", "all": ":"}
FEW_DECADES = 100.0
"""Ratio of the ends of a logarithmic axis beyond which only powers of ten are named."""
NARROW = 6.0
"""Ratio below which ticks are evenly spaced in the values, as 1, 2 and 5 would be too few."""
MODES = {"sonar": "sonar alone", "odometry": "with odometry", "all": "all sensors"}


@dataclass(frozen=True)
class Figure:
    """A figure of the report."""

    name: str
    """Of its files."""
    title: str
    text: str
    """What is shown and how it was computed."""
    drawing: Any
    """Of matplotlib."""


def make_axes(height_in: float, count: int = 1) -> tuple[Any, list[Any]]:
    """Make a figure without a global state of matplotlib, with axes below each other."""
    from matplotlib.figure import Figure as Drawing

    drawing = Drawing(figsize=(WIDTH_IN, height_in), layout="constrained")
    axes = drawing.subplots(count, 1, squeeze=False, sharex=count > 1)[:, 0].tolist()
    for axis in axes:
        axis.grid(alpha=0.3, linewidth=0.6)
        axis.spines[["top", "right"]].set_visible(False)
    return drawing, axes


def use_log_scale(axis: Any, label: str, which: str = "y") -> None:
    """Give an axis, x or y, a logarithmic scale with plain numbers, and its label."""
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

    getattr(axis, f"set_{which}scale")("log")
    getattr(axis, f"set_{which}label")(label)
    own = getattr(axis, f"{which}axis")
    low, high = own.get_view_interval()
    if high < NARROW * low:
        own.set_major_locator(MaxNLocator(5))
        own.set_minor_locator(NullLocator())
    else:
        own.set_major_locator(LogLocator(subs=(1, 2, 5) if high < FEW_DECADES * low else (1,)))
    own.set_major_formatter(FuncFormatter(_format_tick))
    own.set_minor_formatter(FuncFormatter(_format_nothing))


def _format_tick(value: float, _number: int) -> str:
    return f"{value:g}"


def _format_nothing(_value: float, _number: int) -> str:
    return ""


def add_legend(drawing: Any, axis: Any) -> None:
    """Add the legend of an axis below the figure."""
    handles, labels = axis.get_legend_handles_labels()
    drawing.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False, fontsize=8, markerscale=1.3)


def add_legend_of_colours(drawing: Any, axis: Any, colours: Mapping[str, str]) -> None:
    """Name the colours of many matchers, by their names; the text names the markers."""
    for name, colour in colours.items():
        axis.scatter([], [], 16, color=colour, marker="o", label=name)
    add_legend(drawing, axis)


def colour_of(number: int) -> str:
    """Return the colour of a number; they begin again where they are used up."""
    return COLOURS[number % len(COLOURS)]
