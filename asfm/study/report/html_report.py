"""HTML report of a study: one page without network, and its figures and tables as files."""

import io
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from asfm.errors import AsfmError
from asfm.safe_json import read_json
from asfm.study.manifest import MANIFEST
from asfm.study.report.error_law import fit_law
from asfm.study.report.figure_style import Figure
from asfm.study.report.figures import draw_figures
from asfm.study.report.hover_titles import insert_titles
from asfm.study.report.report_page import make_page
from asfm.study.report.sequence_pages import make_sequence_pages
from asfm.study.report.summary_table import format_summary, summarise_rows, to_csv, to_latex, to_markdown
from asfm.study.results_table import Row, write_aside

FIGURES = "figures"


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
    import matplotlib

    law = fit_law(rows)
    with matplotlib.rc_context({"text.parse_math": False}):  # a name may hold a dollar
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
    drawn = [(figure, pictures[figure.name].decode()) for figure in figures]
    page = make_page(rows, drawn, law, manifest, make_sequence_pages(folder, rows))
    write_aside(folder / "report.html", page.encode())


def render(figure: Figure, kind: str) -> bytes:
    """Render a figure as SVG, with the hover titles of its points, or as PDF: the same bytes every time."""
    import matplotlib

    sink = io.BytesIO()
    settings = {"svg.fonttype": "none", "svg.hashsalt": figure.name, "font.size": 9, "font.family": "sans-serif"}
    with matplotlib.rc_context(settings):
        figure.drawing.savefig(sink, format=kind, metadata={"Date": None} if kind == "svg" else {"CreationDate": None})
    return insert_titles(sink.getvalue().decode()).encode() if kind == "svg" else sink.getvalue()
