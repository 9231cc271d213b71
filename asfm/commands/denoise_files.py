"""Output of ``asfm denoise``: the table as CSV, JSON and text, and a picture of the examples."""

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from asfm.atomic_folder import FolderKind
from asfm.commands.text import align
from asfm.results.json_file import write_json
from asfm.types import FrameTruth, ImageArray

if TYPE_CHECKING:
    from asfm.evaluation.denoising.table import Comparison, DenoisingTable

TABLE, REPORT, PICTURE = "denoising.csv", "denoising.json", "denoising.png"
DENOISING = FolderKind("a denoising table", marks=(TABLE, REPORT), patterns=(TABLE, REPORT, PICTURE))
CELL_SIZE_PX = (320, 200)
"""(height, width) of one image in the picture."""
TITLE_HEIGHT_PX = 22
MAX_NAME_LETTERS = 14


def write_denoising(
    folder: Path, table: "DenoisingTable", examples: "Mapping[str, tuple[FrameTruth, Comparison]]"
) -> None:
    """Write denoising.csv (one row per frame and method), denoising.json and denoising.png.

    Args:
        folder: an existing folder.
        table: the comparison.
        examples: by scene, one frame to show in the picture.
    """
    with (folder / TABLE).open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("scene", "sonar", "frame", "method", "psnr_db", "ssim", "support_psnr_db", "wall_ms"))
        for row in table.rows:
            quality = row.quality
            inside = "" if quality.support_psnr_db is None else f"{quality.support_psnr_db:.4f}"
            values = (f"{quality.psnr_db:.4f}", f"{quality.ssim:.5f}", inside, f"{row.wall_ms:.2f}")
            writer.writerow((row.scene, row.sonar, row.frame, row.method, *values))
    write_json(folder / REPORT, table.as_dict())
    (folder / PICTURE).write_bytes(draw_denoising(examples))


def draw_denoising(examples: "Mapping[str, tuple[FrameTruth, Comparison]]") -> bytes:
    """Draw one row per example: the noise-free image, the raw image, each method; near is at the bottom, port left.

    Returns:
        The picture as PNG.
    """
    from asfm.visualization.pictures import encode_picture

    rows = []
    for scene, (truth, comparison) in examples.items():
        cells = {f"{Path(scene).name[:MAX_NAME_LETTERS]}: clean": truth.clean, **comparison.images}
        rows.append(np.hstack([_draw_cell(title, image) for title, image in cells.items()]))
    return encode_picture("png", np.vstack(rows))


def _draw_cell(title: str, image: ImageArray) -> NDArray[np.uint8]:
    """Draw a (ranges, beams) image with its title; its square root is shown, as echoes span orders of magnitude."""
    import cv2

    height, width = CELL_SIZE_PX
    grey = cv2.resize(np.asarray(255 * np.sqrt(np.clip(image, 0, 1))), (width, height), interpolation=cv2.INTER_AREA)
    cell = np.zeros((height + TITLE_HEIGHT_PX, width + 4), dtype=np.uint8)
    cell[TITLE_HEIGHT_PX:, :width] = grey[::-1, ::-1]
    cv2.putText(cell, title, (4, TITLE_HEIGHT_PX - 7), cv2.FONT_HERSHEY_SIMPLEX, 0.45, 255, 1, cv2.LINE_AA)
    return cell


def describe_denoising(table: "DenoisingTable") -> list[str]:
    """Format the mean over all frames, the PSNR by scene and by sonar, and where masking loses PSNR."""
    from asfm.evaluation.denoising.methods import RAW
    from asfm.evaluation.denoising.table import list_losses

    rows = [("method", "PSNR dB", "over raw", "SSIM", "PSNR dB in the support", "ms a frame")]
    raw_db = table.average(RAW).psnr_db
    for method in table.methods:
        mean = table.average(method)
        inside = "" if mean.support_psnr_db is None else f"{mean.support_psnr_db:.2f}"
        over = f"{mean.psnr_db - raw_db:+.2f}"
        rows.append((method, f"{mean.psnr_db:.2f}", over, f"{mean.ssim:.3f}", inside, f"{table.wall_ms(method):.1f}"))
    count = len({row.key for row in table.rows})
    lines = [f"mean over {count} frame{'' if count == 1 else 's'}", *align(rows, numbers=range(1, 6))]
    for group in ("scene", "sonar"):
        lines += _list_groups(table, group)
    return [*lines, "", *list_losses(table), *(f"note: {note}" for note in table.notes)]


def _list_groups(table: "DenoisingTable", group: str) -> list[str]:
    """Format the PSNR of every method for each scene or sonar; nothing where there is only one."""
    names = table.names(group)
    if len(names) < 2:
        return []
    rows = [(f"PSNR dB by {group}", *table.methods)]
    for name in names:
        rows.append((name, *(f"{table.average(method, **{group: name}).psnr_db:.2f}" for method in table.methods)))
    return ["", *align(rows, numbers=range(1, len(table.methods) + 1))]
