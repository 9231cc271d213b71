"""Report of a study: one page that needs nothing else, and its figures and tables as files."""

import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from asfm.errors import AsfmError
from asfm.results.json_file import write_json
from asfm.study.report.html_report import require_matplotlib, write_report
from tests.study.report.rows import make_row, make_rows

VOID = {"meta", "use", "path", "rect", "line", "br", "td", "th", "tr", "li", "thead", "tbody"}


class Outline(HTMLParser):
    """Collects tags that are left open, addresses and text."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.links: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.links += [value or "" for name, value in attrs if name in ("href", "src", "xlink:href")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open.pop() == tag


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    manifest: dict[str, Any] = {
        "study": {"name": "<b>mine</b>", "seeds": [0, 1]},
        "versions": {"asfm": "1", "numpy": "2"},
        "machine": {"cores": 2},
    }
    write_json(tmp_path / "manifest.json", manifest)
    return tmp_path


def test_the_page_stands_alone(folder: Path) -> None:
    rows = [*make_rows(), make_row(error="the <function> raised", missing="no true poses")]
    write_report(folder, rows)
    page = (folder / "report.html").read_text()
    outline = Outline()
    outline.feed(page)
    assert outline.open == [], "every tag is closed"
    assert all(link.startswith(("#", "data:image/")) for link in outline.links), "nothing is loaded from anywhere"
    named = set(re.findall(r'id="([^"]*)"', page))
    assert {link[1:] for link in outline.links if link.startswith("#")} <= named, "every link has its target"
    assert "<script" not in page and not re.search(r"url\((?!#)|@import", page)
    assert "<b>mine</b>" not in page and "&lt;b&gt;mine&lt;/b&gt;" in page
    assert "the &lt;function&gt; raised" in page and "Failed cells" in page and "no true poses" in page
    assert page.count("<svg") == len(list((folder / "figures").glob("*.svg"))) == 6
    assert page.count("<figcaption>") == 6
    for text in ("asfm 1, numpy 2", "cores 2", "seeds:", "log(ATE / bound)", "within", 'name="viewport"'):
        assert text in page, text
    table = page[page.index('<h2 id="all-cells">') :]
    assert table.count("<tr>") == len(rows) + 1


def test_points_tell_their_cells(folder: Path) -> None:
    rows = make_rows()
    write_report(folder, rows)
    page = (folder / "report.html").read_text()
    (figure,) = re.findall(r'aria-label="Precision against pose error">(.*?)</figure>', page, re.DOTALL)
    assert figure.count("<title>") == len(rows)
    first = rows[5]
    assert f"<title>akaze all\nscene0-sonar, sonar alone, seed 0\nprecision {first['precision']:.3g}" in figure
    assert "titles:" not in page and (folder / "figures" / "gaps.svg").read_text().count("<title>") == 3 * 2 * 4


def test_figures_and_tables_are_files_too_and_old_figures_go(folder: Path) -> None:
    (folder / "figures").mkdir()
    (folder / "figures" / "old.svg").touch()
    write_report(folder, make_rows())
    names = {path.stem for path in (folder / "figures").iterdir()}
    assert "old" not in names and "precision_against_ate" in names
    for name in names:
        assert (folder / "figures" / f"{name}.pdf").read_bytes().startswith(b"%PDF")
        assert "</svg>" in (folder / "figures" / f"{name}.svg").read_text()
    for suffix, mark in (("csv", "matcher,filters"), ("md", "| matcher |"), ("tex", "\\toprule")):
        assert mark in (folder / f"summary.{suffix}").read_text()


def test_the_same_rows_give_the_same_bytes(folder: Path) -> None:
    contents = []
    for _ in range(2):
        write_report(folder, make_rows())
        contents.append({path: path.read_bytes() for path in folder.rglob("*") if path.is_file()})
    assert contents[0] == contents[1]


def test_five_hundred_cells_are_a_small_page(folder: Path) -> None:
    rows = make_rows(scenes=6, seeds=6)
    assert len(rows) >= 500
    write_report(folder, rows)
    assert (folder / "report.html").stat().st_size < 2e6, "the other 3 MB are for pictures"


def test_missing_matplotlib_is_said_before_any_work(monkeypatch: pytest.MonkeyPatch) -> None:
    require_matplotlib()
    monkeypatch.setattr("asfm.study.report.html_report.find_spec", lambda name: None)
    with pytest.raises(AsfmError, match=r"pip install 'asfm\[plots\]'"):
        require_matplotlib()
