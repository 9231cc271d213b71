"""Page of a report: its sections, what is left out, and every setting."""

from asfm.study.report.report_page import make_page
from tests.study.report.rows import make_row

MANIFEST = {"study": {"name": "mine", "seeds": [0, 1]}, "versions": {"asfm": "1"}, "machine": {"cores": 2}}


def test_columns_without_values_and_sections_without_content_are_left_out() -> None:
    page = make_page([make_row(ate_m=0.25)], [], None, MANIFEST, "<p>pages of sequences</p>")
    table = page[page.index('<h2 id="all-cells">') :]
    assert "<th>ate m" in table and "<td>0.25" in table
    assert "<th>error" not in table and "<th>warnings" not in table and "<th>precision" not in table
    assert "Failed cells" not in page and "Too few settings" in page
    assert page.index('id="sequences"') < page.index("pages of sequences") < page.index('id="how-it-was-computed"')


def test_study_versions_machine_and_every_setting_are_there() -> None:
    page = make_page([make_row(error="no <images>")], [], None, MANIFEST, "")
    for text in ("seeds: [0, 1]", "Versions: asfm 1", "Machine: cores 2", "max_gap: 8", "no &lt;images&gt;"):
        assert text in page, text
    assert '<a href="#failed-cells">' in page and '<h2 id="failed-cells">' in page
