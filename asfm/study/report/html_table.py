"""HTML tables that scroll by themselves where the page is narrow."""

import html
from collections.abc import Sequence


def make_table(headings: Sequence[str], cells: Sequence[Sequence[str]]) -> str:
    """Make a table.

    Args:
        headings: text of the columns.
        cells: rows of HTML; what comes from elsewhere has been escaped.
    """
    head = "".join(f"<th>{html.escape(text)}" for text in headings)
    body = "\n".join(f"<tr>{''.join(f'<td>{text}' for text in row)}" for row in cells)
    return f'<div class="wide"><table><thead><tr>{head}</thead><tbody>{body}</tbody></table></div>'
