"""Pictures of matches: one frame pair of a cell as two fan images side by side, and lines for its matches."""

import json
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from asfm.evaluation.matcher_quality import usable_truth
from asfm.evaluation.matching import evaluate_pair_by_arcs, find_correct
from asfm.evaluation.trajectory import interpolate_groundtruth
from asfm.evaluation.true_positions import find_true_positions
from asfm.geometry.fan import FanGrid
from asfm.geometry.poses import invert
from asfm.pipeline import Run
from asfm.sequence import Sequence
from asfm.study.cell import Cell
from asfm.study.results_table import write_aside
from asfm.study.sequence_provider import StudySequence
from asfm.types import BoolArray, FloatArray, Frame, ImageArray, IntArray, Matches

PICTURES = "pictures"
"""Folder of the pictures in that of a study: a JSON file a cell, and a JPEG a frame pair, which cells share."""
FAN_PX = 300, 240
"""Largest width and height of one fan image."""
SPACE_PX = 12
"""Between the two fan images."""
GAP = 4
"""Frame gap of the pair that is shown, where it was matched."""
MAX_LINES = 30
"""Most correct matches, and most others, that are drawn."""
JPEG_QUALITY = 45
BY_ELEVATIONS, BY_ARCS = "their true elevations", "their elevation arcs under the true poses"


def choose_illustrated(cells: Iterable[Cell]) -> frozenset[str]:
    """Return the cells that get a picture: of each sequence, matcher, filter chain and back-end the first of all seeds.

    Corrupted matches have none: their images are not looked at.
    """
    first: dict[tuple[str, ...], Cell] = {}
    for cell in cells:
        if cell.corruption is None:
            first.setdefault((cell.sequence.name, cell.matcher, cell.filters, cell.backend), cell)
    return frozenset(cell.id for cell in first.values())


def write_match_picture(folder: Path, cell: Cell, opened: StudySequence, run: Run) -> None:
    """Write the picture of one frame pair of a cell; nothing where no frames were matched.

    Args:
        folder: of the study.
        cell: what was run.
        opened: its sequence.
        run: its result.

    Raises:
        AsfmError: an image or its truth cannot be read, or a file cannot be written.
    """
    sequence = opened.sequence
    pair = _choose_pair(run.matches, len(sequence))
    if pair is None:
        return
    (folder / PICTURES).mkdir(exist_ok=True)
    grid = FanGrid.fit(sequence.sonar, *FAN_PX)
    image = f"{cell.sequence_key}-{pair.frame_a}-{pair.frame_b}.jpg"
    path = folder / PICTURES / image
    if not path.is_file():
        write_aside(path, _draw_pair(grid, *(sequence.read_frame(frame) for frame in (pair.frame_a, pair.frame_b))))
    correct, judged_by = _judge(run, pair, opened)
    keypoints = (run.keypoints[frame] for frame in (pair.frame_a, pair.frame_b))
    ends_px = [
        grid.pixel_at(frame.range_m[index], frame.bearing_rad[index])
        for frame, index in zip(keypoints, pair.index.T, strict=True)
    ]
    ends_px[1] = ends_px[1] + np.array([grid.width_px + SPACE_PX, 0])
    known = np.ones(len(pair), dtype=bool) if correct is None else correct
    content = {
        "image": image,
        "width_px": 2 * grid.width_px + SPACE_PX,
        "height_px": grid.height_px,
        "frames": [int(opened.chosen[frame]) for frame in (pair.frame_a, pair.frame_b)],
        "matches": len(pair),
        "correct": None if correct is None else int(correct.sum()),
        "judged_by": judged_by,
        "correct_lines": _list_lines(ends_px, np.flatnonzero(known)),
        "wrong_lines": _list_lines(ends_px, np.flatnonzero(~known)),
    }
    write_aside(folder / PICTURES / f"{cell.id}.json", json.dumps(content, sort_keys=True).encode())


def _choose_pair(matches: Iterable[Matches], frames: int) -> Matches | None:
    """Return the matched pair whose gap is nearest to GAP, and of those the one nearest to the middle."""

    def distance(pair: Matches) -> tuple[int, int, int]:
        return abs(pair.frame_b - pair.frame_a - GAP), abs(pair.frame_a + pair.frame_b - frames), pair.frame_a

    return min(matches, key=distance, default=None)


def _judge(run: Run, pair: Matches, opened: StudySequence) -> tuple[BoolArray | None, str | None]:
    """Return which of the (M,) matches are correct, and by what; None and None without true poses."""
    sequence: Sequence = opened.sequence
    if sequence.groundtruth is None:
        return None, None
    world_from_sonar = interpolate_groundtruth(sequence) @ sequence.vehicle_from_sonar
    read_truth = usable_truth(sequence, opened.read_truth)
    if read_truth is None:
        return evaluate_pair_by_arcs(run.keypoints, pair, world_from_sonar, sequence.sonar), BY_ARCS
    b_from_a = invert(world_from_sonar[pair.frame_b]) @ world_from_sonar[pair.frame_a]
    truth = find_true_positions(run.keypoints[pair.frame_a], read_truth(pair.frame_a).elevation_rad, b_from_a)
    return find_correct(truth, run.keypoints[pair.frame_b], pair), BY_ELEVATIONS


def _draw_pair(grid: FanGrid, first: Frame, second: Frame) -> bytes:
    """Draw two frames side by side, dark echoes on white, as JPEG."""
    import cv2

    space = np.full((grid.height_px, SPACE_PX), 255, dtype=np.uint8)
    parts = [grid.draw(_invert(frame.image, frame.invalid), fill=255) for frame in (first, second)]
    picture = np.concatenate([parts[0], space, parts[1]], axis=1)
    return bytes(cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1])


def _invert(image: ImageArray, invalid: BoolArray) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """Return the square root of the (ranges, beams) image, as echoes span decades: 255 where there is none."""
    bright = np.sqrt(np.where(invalid, 0.0, np.clip(image, 0, 1)))
    return np.asarray(255 - 255 * bright).astype(np.uint8)


def _list_lines(ends_px: list[FloatArray], chosen: IntArray) -> list[list[float]]:
    """Return x and y of both ends of the chosen matches, at most MAX_LINES of them, evenly over the list."""
    if len(chosen) > MAX_LINES:
        chosen = chosen[np.linspace(0, len(chosen) - 1, MAX_LINES).round().astype(np.int64)]
    rows = np.concatenate([ends[chosen] for ends in ends_px], axis=1)
    return [[round(value, 1) for value in row] for row in rows.tolist()]
