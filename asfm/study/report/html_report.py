"""HTML report of a study: one page without network, and its figures and tables as files."""

import html
import io
import json
import re
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import yaml

from asfm.errors import AsfmError
from asfm.safe_json import read_json
from asfm.study.manifest import MANIFEST
from asfm.study.report.error_law import ErrorLaw, fit_law
from asfm.study.report.figure_style import Figure
from asfm.study.report.figures import draw_figures
from asfm.study.report.page_style import STYLE
from asfm.study.report.summary_table import format_summary, summarise_rows, to_csv, to_latex, to_markdown
from asfm.study.results_table import METRICS, Row, write_aside

FIGURES = "figures"
CELL_COLUMNS = (
    *("sequence", "detector", "filters", "backend", "mode", "seed", "wrong_share", "stated_recall"),
    *("matches", "precision", "recall", "arc_inlier_ratio", "ate_m", "mirror_aware", "ate_over_odometry"),
    *("ate_over_bound", "stationary_ate_m", "rpe_translation_m", "seconds", "warnings", "missing", "error"),
)
"""Columns of the table of all cells; results.csv has more."""


def require_matplotlib() -> None:
    """Check that the figures can be drawn, before hours of work.

    Raises:
        AsfmError: matplotlib is not installed.
    """
    if find_spec("matplotlib") is None:
        raise AsfmError(
            "the figures of a study need matplotlib: install asfm with its extra, pip install 'asfm[plots]'"
        )


def write_report(folder: Path, rows: Sequence[Row]) -> None:
    """Write report.html, figures/ and the summary as CSV, Markdown and LaTeX.

    Args:
        folder: of the study, with its manifest.
        rows: one a cell, in the order of the grid.

    Raises:
        AsfmError: a file cannot be written.
    """
    law = fit_law(rows)
    figures = draw_figures(rows, law)
    target = folder / FIGURES
    try:
        target.mkdir(exist_ok=True)
        for old in target.iterdir():
            old.unlink()
    except OSError as error:
        raise AsfmError(f"{target}: cannot write: {error.strerror}") from None
    pictures = {figure.name: render(figure, "svg") for figure in figures}
    for figure in figures:
        write_aside(target / f"{figure.name}.svg", pictures[figure.name])
        write_aside(target / f"{figure.name}.pdf", render(figure, "pdf"))
    headings, cells = format_summary(summarise_rows(rows))
    for suffix, form in (("csv", to_csv), ("md", to_markdown), ("tex", to_latex)):
        write_aside(folder / f"summary.{suffix}", form(headings, cells).encode())
    manifest = read_json(folder / MANIFEST, "the manifest of a study")
    write_aside(folder / "report.html", make_page(rows, figures, pictures, law, manifest).encode())


def render(figure: Figure, kind: str) -> bytes:
    """Render a figure as SVG or PDF, the same bytes every time."""
    import matplotlib

    sink = io.BytesIO()
    settings = {"svg.fonttype": "none", "svg.hashsalt": figure.name, "font.size": 9, "font.family": "sans-serif"}
    with matplotlib.rc_context(settings):
        figure.drawing.savefig(sink, format=kind, metadata={"Date": None} if kind == "svg" else {"CreationDate": None})
    return sink.getvalue()


def make_page(
    rows: Sequence[Row],
    figures: Sequence[Figure],
    pictures: dict[str, bytes],
    law: ErrorLaw | None,
    manifest: dict[str, Any],
) -> str:
    """Make the page: what was done, the summary, the figures, failures, the configuration and all cells."""
    name = html.escape(str(manifest["study"]["name"]))
    parts = [
        f"<h1>{name}</h1>",
        f"<p>{html.escape(_count_cells(rows))}</p>",
        _section("Means over sequences and seeds", _summary_table(rows), _summary_text()),
        '<h2 id="figures">Figures</h2><div class="figures">',
        *(_figure(figure, pictures[figure.name]) for figure in figures),
        "</div>",
        _law_section(law),
        _failure_section(rows),
        _section("How it was computed", _manifest_text(manifest)),
        _section("All cells", f"<details><summary>{len(rows)} cells</summary>{_cell_table(rows)}</details>"),
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


def _section(title: str, *contents: str) -> str:
    return f"<h2>{html.escape(title)}</h2>{''.join(contents)}"


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
    return _table(headings, cells) if cells else "<p>No cells of real matchers.</p>"


def _cell_table(rows: Sequence[Row]) -> str:
    names = [name for name in CELL_COLUMNS if any(row[name] is not None for row in rows)]
    return _table(
        [name.replace("_", " ") for name in names], [[_show(row[name], name) for name in names] for row in rows]
    )


def _table(headings: Sequence[str], cells: Sequence[Sequence[str]]) -> str:
    head = "".join(f"<th>{html.escape(text)}" for text in headings)
    body = "\n".join(f"<tr>{''.join(f'<td>{text}' for text in row)}" for row in cells)
    return f'<div class="wide"><table><thead><tr>{head}</thead><tbody>{body}</tbody></table></div>'


def _show(value: Any, name: str) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if METRICS.get(name) is float else html.escape(str(value))


def _figure(figure: Figure, picture: bytes) -> str:
    """Return a figure as inline SVG that fills its column."""
    text = picture.decode()
    svg = re.sub(r'(<svg[^>]*?) width="[^"]*"| height="[^"]*"', r"\1", text[text.index("<svg") :], count=2)
    label = html.escape(figure.title)
    picture_html = f'<div role="img" aria-label="{label}">{svg}</div>'
    return f"<figure><h3>{label}</h3>{picture_html}<figcaption>{html.escape(figure.text)}</figcaption></figure>"


def _law_section(law: ErrorLaw | None) -> str:
    if law is None:
        return _section("The law of the pose error", "<p>Too few settings with truth to fit it to.</p>")
    lines = "".join(f"<li>{html.escape(line)}" for line in law.describe())
    text = (
        "<p>Fitted to the geometric means over seeds, by mode, with a weak ridge penalty. Wrong matches is one minus "
        "the precision, noise the root mean square of those in range and bearing in pixels, track length the mean "
        "number of observations of a track in the final graph; logarithms are natural.</p>"
    )
    return _section("The law of the pose error", f"<ul>{lines}</ul>", text)


def _failure_section(rows: Sequence[Row]) -> str:
    failed = [row for row in rows if row["error"] is not None]
    if not failed:
        return ""
    names = ("sequence", "detector", "filters", "mode", "seed", "error")
    return _section("Failed cells", _table(names, [[_show(row[name], name) for name in names] for row in failed]))


def _manifest_text(manifest: dict[str, Any]) -> str:
    versions = ", ".join(f"{name} {version}" for name, version in manifest["versions"].items())
    machine = ", ".join(f"{name} {value}" for name, value in manifest["machine"].items())
    study = yaml.safe_dump(json.loads(json.dumps(manifest["study"])), sort_keys=False)
    return f"<p>{html.escape(versions)}</p><p>{html.escape(machine)}</p><pre>{html.escape(study)}</pre>"
