"""Pages of sequences: stored pictures are embedded once each, and damaged ones are left out."""

import base64
import json
import re
from pathlib import Path
from typing import Any

import pytest

from asfm.study.match_pictures import PICTURES
from asfm.study.report.sequence_pages import make_sequence_pages
from tests.study.report.rows import make_row

ROWS = [
    make_row(cell="a", sequence="first <one>", precision=0.9),
    make_row(cell="b", sequence="first <one>", detector="orb"),
    make_row(cell="c", sequence="second", error="failed"),
    make_row(cell="d", sequence="third", wrong_share=0.1, stated_recall=1.0),
]
PICTURE: dict[str, Any] = {
    "image": "pair.jpg",
    "width_px": 612,
    "height_px": 240,
    "frames": [3, 7],
    "matches": 40,
    "correct": 38,
    "judged_by": "their true elevations",
    "correct_lines": [[1, 2, 303.5, 4]],
    "wrong_lines": [[5, 6, 7, 8], [9, 10, 11, 12]],
}


def write_picture(folder: Path, cell: str, **changes: Any) -> None:
    (folder / PICTURES).mkdir(exist_ok=True)
    (folder / PICTURES / "pair.jpg").write_bytes(b"image of a pair")
    (folder / PICTURES / f"{cell}.json").write_text(json.dumps({**PICTURE, **changes}))


def test_an_image_that_matchers_share_is_embedded_once(tmp_path: Path) -> None:
    write_picture(tmp_path, "a")
    write_picture(tmp_path, "b", correct=None, judged_by=None)
    pages = make_sequence_pages(tmp_path, ROWS)
    assert pages.count("<details") == 2, "a page a sequence of real matchers"
    assert "<summary>first &lt;one&gt;: 2 cells</summary>" in pages and "second: 1 cells, 1 failed" in pages
    assert pages.count(base64.b64encode(b"image of a pair").decode()) == 1
    (key,) = re.findall(r'<image id="([^"]*)"', pages)
    assert pages.count(f'<use href="#{key}"/>') == 2 == pages.count('viewBox="0 0 612 240"')
    assert pages.count('<path class="correct" d="M1 2L303.5 4"/>') == 2
    assert pages.count('<path class="wrong" d="M5 6L7 8M9 10L11 12"/>') == 2
    assert "akaze, all: 38 of 40 matches correct (95 %) by their true elevations; frames 3 and 7" in pages
    assert "orb, all: 40 matches, not judged; frames 3 and 7" in pages


@pytest.mark.parametrize(
    "changes",
    [
        {"width_px": "wide"},
        {"correct_lines": [[1, 2, 3]]},
        {"wrong_lines": [[1, 2, 3, "<b>"]]},
        {"image": "../../pair.png"},
        {"frames": None},
    ],
)
def test_a_damaged_picture_is_left_out(tmp_path: Path, changes: dict[str, Any]) -> None:
    write_picture(tmp_path, "a", **changes)
    pages = make_sequence_pages(tmp_path, ROWS)
    assert "<svg" not in pages and "No pictures of matches" in pages


def test_a_pair_without_matches_has_no_lines(tmp_path: Path) -> None:
    write_picture(tmp_path, "a", matches=0, correct=0, correct_lines=[], wrong_lines=[])
    pages = make_sequence_pages(tmp_path, ROWS)
    assert "<path" not in pages and "akaze, all: no matches; frames 3 and 7" in pages
    assert make_sequence_pages(tmp_path, ROWS[3:]) == "<p>No cells of real matchers.</p>"
