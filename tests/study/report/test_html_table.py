"""Tables in HTML: headings are escaped, cells are HTML already."""

from asfm.study.report.html_table import make_table


def test_headings_are_escaped_and_rows_are_in_order() -> None:
    table = make_table(["a<b", "c"], [["1", "<b>2</b>"], ["3", "4"]])
    assert table.startswith('<div class="wide"><table>') and table.count("<tr>") == 3
    assert "<th>a&lt;b<th>c" in table
    assert table.index("<td>1<td><b>2</b>") < table.index("<td>3<td>4")
