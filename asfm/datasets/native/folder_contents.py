"""Contents of a native folder: files that are not used, and the order of the numbers in image names."""

import re
from decimal import Decimal
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from asfm.datasets.tables import Row
from asfm.diagnostics import Diagnostic, frame_runs

READ_FILES = (
    "sequence.yaml",
    "frames.csv",
    "odometry.tum",
    "navigation.csv",
    "groundtruth.tum",
    "landmarks.csv",
    "truth",
)
EXTERNAL_FILES = ("features.h5", "matches.h5")
"""Results of hloc, which stay beside the sequence and are given by option."""
DATA_SUFFIXES = (
    ".csv",
    ".tum",
    ".txt",
    ".dat",
    ".tsv",
    ".json",
    ".yaml",
    ".yml",
    ".npz",
    ".npy",
    ".mat",
    ".bag",
    ".db3",
)
NOTES = ("readme", "license", "licence", "copying", "citation", "changelog", "notice", "requirements")
SIMILARITY = 0.75
"""Ratio of :mod:`difflib` from which a name is a misspelt one."""
SYNONYMS = {
    "odometry.tum": ("odom", "odometer", "dvl", "dead_reckoning", "deadreckoning", "dr", "poses", "pose", "trajectory"),
    "navigation.csv": ("nav", "depth", "attitude", "imu", "ahrs", "pressure", "roll_pitch", "ins"),
    "groundtruth.tum": ("gt", "ground_truth", "truth", "mocap", "reference", "poses_gt"),
    "landmarks.csv": ("landmark", "hand_tracks", "tracks"),
    "frames.csv": ("images", "timestamps", "stamps", "times"),
}
"""Names that other tools give to the same contents, without suffix and in lower case."""
NUMBER = re.compile(r"\d+(?:\.\d+)?")


def find_unused_files(folder: Path) -> list[Diagnostic]:
    """Find data files at the top of a native folder that no reader looks at.

    Returns:
        A warning for each file that looks like a sensor's under another name, and one note for all others.
    """
    found, others = [], []
    for path in sorted(folder.iterdir()):
        name = path.name
        meant = _guess_meaning(name)
        if name in READ_FILES + EXTERNAL_FILES or name.startswith(".") or not path.is_file() or _is_note(name):
            continue
        if meant is not None:
            where = " beside it" if (folder / meant).exists() else ""
            message = (
                f"{name[:80]} is not used: a sequence is read from {meant}{where}; rename or convert it if it is that"
            )
            found.append(Diagnostic("unused-file", message))
        elif path.suffix.lower() in DATA_SUFFIXES:
            others.append(name[:80])
    if others:
        more = f" and {len(others) - 5} more" if len(others) > 5 else ""
        message = f"no part of a sequence is read from {', '.join(others[:5])}{more}"
        found.append(Diagnostic("unused-file", message, severity="info"))
    return found


def check_image_order(path: Path, rows: list[Row], column: int) -> list[Diagnostic]:
    """Check that the numbers in the names of images rise from frame to frame, where the names have numbers at all.

    Names that differ in more than their numbers are in no order that could be checked.

    Args:
        path: frames.csv, for messages.
        rows: its rows.
        column: position of the column of names.
    """
    names = [cells[column] for _, cells in rows]
    if len({NUMBER.sub("#", name) for name in names}) > 1 or not NUMBER.search(names[0]):
        return []
    numbers = [tuple(Decimal(number) for number in NUMBER.findall(name)) for name in names]
    wrong = [index for index in range(1, len(names)) if numbers[index] <= numbers[index - 1]]
    if not wrong:
        return []
    first = wrong[0]
    message = (
        f"{path.name}, line {rows[first][0]}: the image {names[first][-80:]} follows {names[first - 1][-80:]}: numbers "
        f"in the names do not rise with the stamps, {len(wrong)} times; sort the images by number if they were taken so"
    )
    selected = np.zeros(len(names), dtype=bool)
    selected[wrong] = True
    return [Diagnostic("images-out-of-order", message, frame_runs(selected))]


def _guess_meaning(name: str) -> str | None:
    """Return the file that a name stands for, or None where it resembles none."""
    stem = name.lower().split(".")[0].replace("-", "_").replace(" ", "_")
    for meant, synonyms in SYNONYMS.items():
        known = meant.split(".")[0]
        if stem in synonyms or stem.startswith(known) or get_close_matches(stem, [known], cutoff=SIMILARITY):
            return meant
    return None


def _is_note(name: str) -> bool:
    return name.lower().startswith(NOTES)
