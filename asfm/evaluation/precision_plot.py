"""Plot of the matches' precision against the absolute trajectory error of several runs."""

import io
import logging
from collections.abc import Sequence
from typing import TYPE_CHECKING

from asfm.evaluation.run_comparison import ComparedRun

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
"""Colours that the colour-blind can tell apart (Okabe and Ito 2008), one a matcher."""
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
"""One a sequence."""
MAX_NAMED = 15
"""The points of more runs are not named in the plot."""
LOGARITHMIC_RATIO = 8
"""The error is drawn on a logarithmic axis where the largest is this many times the smallest."""
RIGHT_SHARE = 0.8
"""Names of points beyond this share of the width stand to their left."""
MIN_SPAN = 0.1
"""Smallest span of the axis of precision."""
SIZE_IN = (8.0, 5.0)
NO_MATPLOTLIB = (
    "matplotlib, which draws the plot, is not installed; pip install matplotlib, or the extra plots of asfm, brings it"
)


def plottable(runs: Sequence[ComparedRun]) -> list[ComparedRun]:
    """Return the runs with an ATE and with a precision, or an arc inlier ratio in its place."""
    return [run for run in runs if _locate(run) is not None]


def draw_precision(runs: Sequence[ComparedRun]) -> dict[str, bytes]:
    """Draw the precision of the matches against the ATE, one point a run.

    Where the precision is unknown, the share on the elevation arc takes its place as a hollow marker.

    Args:
        runs: as :func:`plottable` returns them, one or more.

    Returns:
        The same picture as ``svg`` and ``png``; the same runs give the same bytes.

    Raises:
        ImportError: matplotlib is not installed.
    """
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # it reports the building of its font cache
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context({"svg.hashsalt": "asfm", "font.size": 9}):
        figure = Figure(figsize=SIZE_IN, layout="constrained")
        axes = figure.add_subplot()
        _draw_points(axes, runs)
        _label_axes(axes, runs)
        _draw_legend(figure, runs)
        return {kind: _encode(figure, kind) for kind in ("svg", "png")}


def _locate(run: ComparedRun) -> tuple[float, float] | None:
    """Return where the point of a run lies: precision, or share on the arc, and ATE; None where one is unknown."""
    share = run.precision if run.precision is not None else run.arc_inlier_ratio
    return None if share is None or run.ate_m is None else (share, run.ate_m)


def _styles(names: Sequence[str], styles: Sequence[str]) -> dict[str, str]:
    """Return a style of each different name, in their order; they repeat where there are more names."""
    return {name: styles[number % len(styles)] for number, name in enumerate(dict.fromkeys(names))}


def _draw_points(axes: "Axes", runs: Sequence[ComparedRun]) -> None:
    colour = _styles([run.labels.matcher for run in runs], COLOURS)
    marker = _styles([run.labels.sequence for run in runs], MARKERS)
    points = [(run, place) for run in runs if (place := _locate(run)) is not None]
    _limit_axes(axes, [share for _, (share, _) in points], [ate_m for _, (_, ate_m) in points])
    for run, (share, ate_m) in points:
        own = colour[run.labels.matcher]
        face = own if run.precision is not None else "none"
        axes.plot([share], [ate_m], marker[run.labels.sequence], color=own, markerfacecolor=face, markersize=8)
        if len(points) <= MAX_NAMED:
            _name_point(axes, run, share, ate_m)


def _limit_axes(axes: "Axes", shares: list[float], errors_m: list[float]) -> None:
    """Set the limits of the axes; precisions that are nearly alike are drawn nearly alike."""
    half = max((max(shares) - min(shares)) * 0.6, MIN_SPAN / 2)
    middle = min((min(shares) + max(shares)) / 2, 1.0 + 0.05 * half - half)
    axes.set_xlim(middle - half, middle + half)
    if min(errors_m) > 0 and max(errors_m) >= LOGARITHMIC_RATIO * min(errors_m):
        axes.set_yscale("log")
        axes.set_ylim(0.7 * min(errors_m), 1.4 * max(errors_m))
    else:
        axes.set_ylim(0.0, 1.15 * max(errors_m) or 1.0)


def _name_point(axes: "Axes", run: ComparedRun, share: float, ate_m: float) -> None:
    """Write the name of a run beside its point, inside the axes."""
    name = _plain(run.labels.run) + ("*" if run.mirror_ambiguous else "")
    low, high = axes.get_xlim()
    right = share > low + RIGHT_SHARE * (high - low)
    axes.annotate(
        name,
        (share, ate_m),
        xytext=(-7 if right else 7, 4),
        textcoords="offset points",
        ha="right" if right else "left",
        fontsize=8,
    )


def _label_axes(axes: "Axes", runs: Sequence[ComparedRun]) -> None:
    axes.grid(which="both", alpha=0.25)
    remarks = ["hollow: share on the elevation arc"] if any(run.precision is None for run in runs) else []
    if any(run.mirror_ambiguous for run in runs):
        remarks.append("*: ATE of the run or of its mirror image, whichever is less")
    under = f"\n({'; '.join(remarks)})" if remarks else ""
    axes.set_xlabel(f"precision of matches, all frame pairs{under}")
    axes.set_ylabel("ATE RMSE in m, SE(3)-aligned, scale off")


def _draw_legend(figure: "Figure", runs: Sequence[ComparedRun]) -> None:
    """Name the colours of the matchers, and the markers of the sequences, above the plot."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    colour = _styles([run.labels.matcher for run in runs], COLOURS)
    marker = _styles([run.labels.sequence for run in runs], MARKERS)
    handles: list[Patch | Line2D] = [Patch(color=own, label=_plain(name)) for name, own in colour.items()]
    for name, own in marker.items():
        handles.append(Line2D([], [], color="0.4", marker=own, markersize=8, linestyle="", label=_plain(name)))
    figure.legend(handles=handles, loc="outside upper left", ncols=2, frameon=False)


def _plain(name: str) -> str:
    """Return a name that Matplotlib neither takes for mathematics nor leaves out of a legend."""
    return (f"\u200b{name}" if name.startswith("_") else name).replace("$", r"\$")


def _encode(figure: "Figure", kind: str) -> bytes:
    buffer = io.BytesIO()
    metadata = {"Date": None} if kind == "svg" else {"Software": None}
    figure.savefig(buffer, format=kind, dpi=150, metadata=metadata)
    return buffer.getvalue()
