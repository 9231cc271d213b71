"""HTML page of a study's report: summary, figures, law, sequences, failures, configuration and all cells."""

import html
import json
import re
from collections.abc import Sequence
from typing import Any

import yaml

from asfm.config import Config
from asfm.study.report.error_law import ErrorLaw
from asfm.study.report.figure_style import Figure
from asfm.study.report.html_table import make_table
from asfm.study.report.page_style import STYLE
from asfm.study.report.summary_table import format_summary, note_unequal_cells, summarise_rows
from asfm.study.results_table import METRICS, Row

MEANS, FIGURES, LAW, SEQUENCES = "Means over sequences and seeds", "Figures", "The law of the pose error", "Sequences"
FAILED, COMPUTATION, CELLS = "Failed cells", "How it was computed", "All cells"
SECTIONS = (MEANS, FIGURES, LAW, SEQUENCES, FAILED, COMPUTATION, CELLS)
CELL_COLUMNS = (
    *("sequence", "detector", "filters", "backend", "mode", "seed", "wrong_share", "stated_recall"),
    *("matches", "precision", "recall", "arc_inlier_ratio", "ate_m", "mirror_aware", "ate_over_odometry"),
    *("ate_over_bound", "stationary_ate_m", "rpe_translation_m", "seconds", "warnings", "missing", "error"),
)
"""Columns of the table of all cells; results.csv has more."""


def make_page(
    rows: Sequence[Row],
    figures: Sequence[tuple[Figure, str]],
    law: ErrorLaw | None,
    manifest: dict[str, Any],
    sequence_pages: str,
) -> str:
    """Make the page: what was done, the summary, the figures, the sequences, failures, configuration and all cells.

    Args:
        rows: one a cell.
        figures: each with its SVG.
        law: fitted to the rows, or None.
        manifest: of the study.
        sequence_pages: HTML of the pages of the sequences.
    """
    name = html.escape(str(manifest["study"]["name"]))
    parts = [
        f"<h1>{name}</h1>",
        f"<p>{html.escape(_count_cells(rows))}</p>",
        _list_contents([title for title in SECTIONS if title != FAILED or any(row["error"] for row in rows)]),
        _section(MEANS, _summary_table(rows), _summary_text()),
        _section(FIGURES, '<div class="figures">', *(_figure(*figure) for figure in figures), "</div>"),
        _law_section(law),
        _section(SEQUENCES, sequence_pages),
        _failure_section(rows),
        _section(COMPUTATION, _manifest_text(manifest)),
        '<section class="cells">',
        _section(CELLS, f"<details><summary>{len(rows)} cells</summary>{_cell_table(rows)}</details>"),
        "</section>",
    ]
    head = '<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
    body = "\n".join(parts)
    head += f"<title>{name}</title><style>{STYLE}</style>"
    return f'<!DOCTYPE html>\n<html lang="en"><head>{head}</head>\n<body>{body}</body></html>\n'


def _count_cells(rows: Sequence[Row]) -> str:
    failed = sum(row["error"] is not None for row in rows)
    sequences, seeds = (len({row[name] for row in rows}) for name in ("sequence", "seed"))
    left_out = sorted({row["missing"] for row in rows if row["missing"]})
    text = f"cells: {len(rows)}, sequences: {sequences}, seeds: {seeds}, failed: {failed}."
    return text + "".join(f" Left out for some: {what}." for what in left_out)


def _list_contents(titles: Sequence[str]) -> str:
    links = (f'<a href="#{_name(title)}">{html.escape(title)}</a>' for title in titles)
    return f"<nav>{' '.join(links)}</nav>"


def _name(title: str) -> str:
    """Return the identifier of a section."""
    return title.lower().replace(" ", "-")


def _section(title: str, *contents: str) -> str:
    return f'<h2 id="{_name(title)}">{html.escape(title)}</h2>{"".join(contents)}'


def _summary_text() -> str:
    return (
        "<p>ATE is the RMSE of positions after SE(3) alignment without scale; with the sonar alone, of the nearer of "
        "the run and its mirror image, between which the sonar cannot tell. ATE, ATE / odometry and ATE / bound are "
        "geometric means, all others arithmetic ones. The bound is the error of the same graph with true "
        "associations and ideal points under the measured noise. Time is that of one "
        "reconstruction without its shared features.</p>"
    )


def _summary_table(rows: Sequence[Row]) -> str:
    headings, cells = format_summary(summarise_rows(rows), html.escape)
    note = note_unequal_cells(rows)
    return (f"<p>{note}</p>" if note else "") + (
        make_table(headings, cells) if cells else "<p>No cells of real matchers.</p>"
    )


def _cell_table(rows: Sequence[Row]) -> str:
    names = [name for name in CELL_COLUMNS if any(row[name] not in (None, "") for row in rows)]
    return make_table(
        [name.replace("_", " ") for name in names], [[_show(row[name], name) for name in names] for row in rows]
    )


def _show(value: Any, name: str) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if METRICS.get(name) is float else html.escape(str(value))


def _figure(figure: Figure, text: str) -> str:
    """Return a figure as inline SVG that fills its column."""
    svg = re.sub(r'(<svg[^>]*?) width="[^"]*"| height="[^"]*"', r"\1", text[text.index("<svg") :], count=2)
    label = html.escape(figure.title)
    picture_html = f'<div role="img" aria-label="{label}">{svg}</div>'
    return f"<figure><h3>{label}</h3>{picture_html}<figcaption>{html.escape(figure.text)}</figcaption></figure>"


def _law_section(law: ErrorLaw | None) -> str:
    if law is None:
        return _section(LAW, "<p>Too few settings with truth to fit it to.</p>")
    lines = "".join(f"<li>{html.escape(line)}" for line in law.describe())
    text = (
        "<p>Fitted to the geometric means over seeds, by mode, with a weak ridge penalty. Wrong matches is one minus "
        "the precision, noise the root mean square of those in range and bearing in pixels, track length the mean "
        "number of observations of a track in the final graph; logarithms are natural.</p>"
    )
    return _section(LAW, f"<ul>{lines}</ul>", text)


def _failure_section(rows: Sequence[Row]) -> str:
    failed = [row for row in rows if row["error"] is not None]
    if not failed:
        return ""
    names = ("sequence", "detector", "filters", "mode", "seed", "error")
    return _section(FAILED, make_table(names, [[_show(row[name], name) for name in names] for row in failed]))


def _manifest_text(manifest: dict[str, Any]) -> str:
    versions = ", ".join(f"{name} {version}" for name, version in manifest["versions"].items())
    machine = ", ".join(f"{name} {value}" for name, value in manifest["machine"].items())
    study = yaml.safe_dump(json.loads(json.dumps(manifest["study"])), sort_keys=False, default_flow_style=None)
    defaults = yaml.safe_dump(Config().model_dump(mode="json"), sort_keys=False, default_flow_style=None)
    return (
        f"<p>Versions: {html.escape(versions)}</p><p>Machine: {html.escape(machine)}</p>"
        f"<h3>The study</h3><pre>{html.escape(study)}</pre>"
        "<details><summary>Settings where the study changes nothing</summary>"
        f"<pre>{html.escape(defaults)}</pre></details>"
    )
