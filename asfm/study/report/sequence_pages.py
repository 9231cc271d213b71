"""Pages of the sequences: of each one its table of means and pictures of its matches, collapsed."""

import base64
import html
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from asfm.errors import AsfmError
from asfm.safe_json import read_json
from asfm.study.match_pictures import GAP, MAX_LINES, PICTURES
from asfm.study.report.html_table import make_table
from asfm.study.report.summary_table import format_summary, summarise_rows
from asfm.study.results_table import Row

Picture = dict[str, Any]
TEXT = (
    "One page a sequence: means over its seeds, and the matches of one frame pair of every matcher and filter chain. "
    f"The pair is the one nearest to {GAP} frames apart in the middle of the sequence, of the first cell (first seed "
    "and mode); the earlier frame is left, the later one right, as fan images with the sonar below, dark where the "
    "echo is strong (square root of the image). Solid blue lines are correct matches, dashed orange ones wrong, judged "
    "by what the caption names; without true poses none is judged, and all are blue. At most "
    f"{MAX_LINES} of either kind are drawn, evenly over the list. True matches of stated quality have no pictures."
)


def make_sequence_pages(folder: Path, rows: Sequence[Row]) -> str:
    """Make one collapsed page a sequence, from the pictures that were stored when the cells were computed.

    Args:
        folder: of the study.
        rows: one a cell.
    """
    real = [row for row in rows if row["wrong_share"] is None]
    names = dict.fromkeys(row["sequence"] for row in real)
    pages = [
        _make_page(folder, f"s{number}", name, [row for row in real if row["sequence"] == name])
        for number, name in enumerate(names)
    ]
    return f"<p>{html.escape(TEXT)}</p>{''.join(pages)}" if pages else "<p>No cells of real matchers.</p>"


def _make_page(folder: Path, key: str, name: str, rows: Sequence[Row]) -> str:
    failed = sum(row["error"] is not None for row in rows)
    title = f"{name}: {len(rows)} cells" + (f", {failed} failed" if failed else "")
    table = make_table(*format_summary(summarise_rows(rows), html.escape))
    found = [(row, picture) for row in rows if (picture := _read_picture(folder, row)) is not None]
    images = {image: f"{key}-{number}" for number, image in enumerate(dict.fromkeys(one["image"] for _, one in found))}
    shared = "".join(_embed(folder / PICTURES / image, images[image]) for image in images)
    figures = "".join(_make_figure(row, picture, images[picture["image"]]) for row, picture in found)
    pictures = (
        f'{shared}<div class="pictures">{figures}</div>' if found else "<p>No pictures of matches are stored.</p>"
    )
    return f'<details class="sequence"><summary>{html.escape(title)}</summary>{table}{pictures}</details>'


def _read_picture(folder: Path, row: Row) -> Picture | None:
    """Read the picture of a cell; None where it has none, or where it is damaged."""
    path = folder / PICTURES / f"{row['cell']}.json"
    if not path.is_file():
        return None
    try:
        picture = read_json(path, "the picture of a cell")
        checked: Picture = {name: int(picture[name]) for name in ("width_px", "height_px", "matches")}
        checked |= {name: _check_lines(picture[name]) for name in ("correct_lines", "wrong_lines")}
        checked["frames"] = [int(frame) for frame in picture["frames"]]
        checked["correct"] = None if picture["correct"] is None else int(picture["correct"])
        checked |= {"image": Path(str(picture["image"])).name, "judged_by": picture["judged_by"]}
    except (AsfmError, KeyError, TypeError, ValueError):
        return None
    return checked if (folder / PICTURES / checked["image"]).is_file() else None


def _check_lines(lines: Any) -> list[list[float]]:
    checked = [[float(value) for value in line] for line in lines]
    if any(len(line) != 4 or not all(map(math.isfinite, line)) for line in checked):
        raise ValueError("expected x and y of both ends")
    return checked


def _embed(path: Path, key: str) -> str:
    """Embed an image once; the figures refer to it by its key."""
    data = base64.b64encode(path.read_bytes()).decode()
    image = f'<image id="{key}" href="data:image/jpeg;base64,{data}"/>'
    return f'<svg class="shared" width="0" height="0" aria-hidden="true"><defs>{image}</defs></svg>'


def _make_figure(row: Row, picture: Picture, key: str) -> str:
    width, height = picture["width_px"], picture["height_px"]
    drawn = [
        f'<path class="{kind}" d="{_make_path(picture[f"{kind}_lines"])}"/>'
        for kind in ("correct", "wrong")
        if picture[f"{kind}_lines"]
    ]
    name = ", ".join(row[axis] for axis in ("detector", "filters", "backend") if row[axis] != "default")
    label = html.escape(f"{name}: {_count(picture)}")
    svg = (
        f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="{label}"><title>{label}</title>'
        f'<use href="#{key}"/>{"".join(drawn)}</svg>'
    )
    return f"<figure>{svg}<figcaption>{label}</figcaption></figure>"


def _make_path(lines: Sequence[Sequence[float]]) -> str:
    return "".join(f"M{x_a:g} {y_a:g}L{x_b:g} {y_b:g}" for x_a, y_a, x_b, y_b in lines)


def _count(picture: Picture) -> str:
    frames, total, correct = "frames {} and {}".format(*picture["frames"]), picture["matches"], picture["correct"]
    if correct is None or not total:
        return f"{total} matches, not judged; {frames}" if total else f"no matches; {frames}"
    return f"{correct} of {total} matches correct ({100 * correct / total:.0f} %) by {picture['judged_by']}; {frames}"
