"""Paths in a native folder: images named in frames.csv and sensor files, none of which may lead outside."""

import os
from pathlib import Path

from asfm.datasets.tables import Row
from asfm.errors import AsfmError, quote
from asfm.regular_file import check_inside, is_present

FILES = ("sequence.yaml", "frames.csv", "odometry.tum", "navigation.csv", "groundtruth.tum", "landmarks.csv")
MAX_NAME = 255
"""Characters of an image's path in the folder."""


def check_places(folder: Path) -> None:
    """Check that no file of a native folder is a link that leads outside.

    Raises:
        AsfmError: one does.
    """
    for name in FILES:
        path = folder / name
        if is_present(path) and path.is_symlink() and path.exists():
            check_inside(folder, path, "a file")


def locate_images(table: Path, rows: list[Row], column: int) -> list[Path | None]:
    """Return the paths of the images that a column of frames.csv names.

    Args:
        table: frames.csv.
        rows: its rows.
        column: position of the column.

    Returns:
        A path for each row, None where the cell is empty.

    Raises:
        AsfmError: a path is absolute, longer than 255 characters, or leads out of the folder, also by links.
    """
    folder, checked = table.parent, set[str]()
    paths: list[Path | None] = []
    for line, cells in rows:
        name = cells[column]
        if not name:
            paths.append(None)
            continue
        path = folder / name
        if len(name) > MAX_NAME or Path(name).is_absolute():
            raise AsfmError(f"{table}, line {line}: expected the path of an image in the folder, found {quote(name)}")
        parent = os.path.dirname(name)  # noqa: PTH120  (pathlib takes ten times as long)
        if parent not in checked or path.is_symlink():
            try:
                check_inside(folder, path, "an image")
            except AsfmError as error:
                raise AsfmError(f"{table}, line {line}: {error}") from None
            checked.add(parent)
        paths.append(path)
    return paths
