"""External matchers of a study: files of hloc, and Python functions that are called with two images.

A function takes two images (ranges, beams), float32 in 0..1, and returns the keypoints of both, (Ka, 2) and (Kb, 2) as
(x, y) with pixel centres at integers, and the matches (M, 2), indices of both. It is the user's code, and it is run.
"""

from collections.abc import Callable
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from asfm.datasets.hloc.features_matches import read_hloc
from asfm.datasets.hloc.image_names import name_images
from asfm.errors import AsfmError, quote
from asfm.frame_selection import take_matches
from asfm.geometry.sonar import SonarModel
from asfm.study.cell import Cell, External
from asfm.study.feature_cache import StudyCache
from asfm.study.fingerprint import hash_content
from asfm.study.match_files import read_keypoints, read_matches, write_keypoints, write_matches
from asfm.study.sequence_provider import StudySequence
from asfm.types import ExternalMatches, FloatArray, ImageArray, IntArray, Keypoints, Matches

SAME_POSITION_DECIMALS = 3
"""Keypoints of one frame from different pairs at the same position to this many decimals of a pixel are one."""
MAX_OUTSIDE_PX = 1.0
Function = Callable[[ImageArray, ImageArray], Any]


def provide_external(cell: Cell, opened: StudySequence, cache: StudyCache) -> ExternalMatches:
    """Return the keypoints and matches of an external matcher for the sequence of a cell.

    Raises:
        AsfmError: the files do not fit the sequence, or the function cannot be loaded, raises or returns what is no
            keypoints and matches.
    """
    matcher = cell.external
    assert matcher is not None
    if matcher.features is not None and matcher.matches is not None:
        names = name_images(opened.path, opened.whole)
        return take_matches(read_hloc(matcher.features, matcher.matches, opened.whole, names), opened.chosen)
    frames, gap = cell.config.frames.model_dump(mode="json"), cell.config.matching.max_gap
    key = hash_content([cell.sequence_key, matcher.content, frames, gap])

    def write(folder: Path) -> None:
        found = match_by_function(matcher, opened, gap)
        write_keypoints(folder / "keypoints.npz", found.keypoints)
        write_matches(folder / "matches.npz", found.matches)

    folder = cache.provide("external", key, write)
    return ExternalMatches(tuple(read_keypoints(folder / "keypoints.npz")), tuple(read_matches(folder / "matches.npz")))


def match_by_function(matcher: External, opened: StudySequence, max_gap: int) -> ExternalMatches:
    """Call the function of an external matcher for every pair of frames up to a gap.

    Raises:
        AsfmError: the function cannot be loaded, raises, or returns what is no keypoints and matches.
    """
    sequence = opened.sequence
    match = _load(matcher) if not matcher.learned else _load_learned(matcher.name, sequence.sonar)
    positions: list[dict[tuple[float, float], int]] = [{} for _ in range(len(sequence))]
    images: dict[int, ImageArray] = {}
    matches = []
    for b in range(len(sequence)):
        images[b] = sequence.read_frame(b).image
        images.pop(b - max_gap - 1, None)
        for a in range(b - 1, max(0, b - max_gap) - 1, -1):
            where = f"external matcher {matcher.name}, frames {a} and {b}"
            xy_a, xy_b, index = _call(match, where, images[a], images[b])
            numbers = [_number(xy_px, positions[frame]) for frame, xy_px in ((a, xy_a), (b, xy_b))]
            pairs = np.stack([numbers[0][index[:, 0]], numbers[1][index[:, 1]]], axis=1)
            pairs = np.unique(pairs, axis=0)
            matches.append(Matches(a, b, pairs.astype(np.int64), np.full(len(pairs), 0.5)))
    return ExternalMatches(tuple(_make_keypoints(found, sequence.sonar) for found in positions), tuple(matches))


def _load_learned(name: str, sonar: SonarModel) -> Function:
    """Return a learned matcher for the images of a sonar; its networks run on one thread, as all of a cell does."""
    from asfm.learned.catalogue import find_learned_matcher
    from asfm.learned.weights import use_one_thread

    match = find_learned_matcher(name)
    use_one_thread()
    return partial(match, sonar=sonar)


def _load(matcher: External) -> Function:
    module, _, name = str(matcher.function).partition(":")
    try:
        function = getattr(import_module(module), name, None)
    except Exception as error:
        raise AsfmError(f"external matcher {matcher.name}: cannot import {module}: {_describe(error)}") from error
    if not callable(function):
        raise AsfmError(f"external matcher {matcher.name}: expected a function {quote(name)} in {module}, found none")
    return function  # type: ignore[no-any-return]


def _call(
    match: Function, where: str, image_a: ImageArray, image_b: ImageArray
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Call the function and check what it returns."""
    try:
        result = match(image_a.copy(), image_b.copy())
    except Exception as error:
        raise AsfmError(f"{where}: the function raised {_describe(error)}") from error
    if not isinstance(result, tuple | list) or len(result) != 3:
        raise AsfmError(f"{where}: expected keypoints, keypoints and matches, found {quote(type(result).__name__)}")
    xy_a = _check_keypoints(f"{where}, keypoints of the first image", result[0], image_a.shape)
    xy_b = _check_keypoints(f"{where}, keypoints of the second image", result[1], image_b.shape)
    index = _as_array(f"{where}, matches", result[2])
    if index.size and (not np.isfinite(index).all() or (index % 1).any()):
        raise AsfmError(f"{where}: expected whole numbers as matches, found others")
    outside = (index < 0) | (index >= [len(xy_a), len(xy_b)])
    for row, column in np.argwhere(outside)[:1]:
        count = (len(xy_a), len(xy_b))[column]
        raise AsfmError(
            f"{where}: match {row} has the index {int(index[row, column])}, expected one of {count} keypoints"
        )
    return xy_a, xy_b, index.astype(np.int64)


def _check_keypoints(where: str, found: Any, shape: tuple[int, ...]) -> FloatArray:
    xy_px = _as_array(where, found)
    inside = np.isfinite(xy_px) & (xy_px >= -0.5 - MAX_OUTSIDE_PX)
    inside &= xy_px <= np.array(shape[::-1]) - 0.5 + MAX_OUTSIDE_PX
    for row in np.flatnonzero(~inside.all(axis=1))[:1]:
        size = f"{shape[1]} x {shape[0]}"
        raise AsfmError(f"{where}: number {row} is at {quote(xy_px[row].tolist())}, outside of {size} pixels")
    return xy_px


def _as_array(where: str, found: Any) -> FloatArray:
    """Return an (N, 2) array; an empty one of any shape has no rows."""
    try:
        values = np.asarray(found, dtype=float)
    except (TypeError, ValueError):
        raise AsfmError(f"{where}: expected numbers (N, 2), found {quote(type(found).__name__)}") from None
    if not values.size:
        return np.zeros((0, 2))
    if values.ndim != 2 or values.shape[1] != 2:
        raise AsfmError(f"{where}: expected numbers (N, 2), found the shape {list(values.shape)}")
    return values


def _number(xy_px: FloatArray, known: dict[tuple[float, float], int]) -> IntArray:
    """Return the numbers (K,) of positions among the keypoints of a frame; new ones are added."""
    rounded = [(x + 0.0, y + 0.0) for x, y in np.round(xy_px, SAME_POSITION_DECIMALS).tolist()]
    return np.array([known.setdefault(position, len(known)) for position in rounded], dtype=np.int64)


def _make_keypoints(positions: dict[tuple[float, float], int], sonar: SonarModel) -> Keypoints:
    xy_px = np.array(list(positions), dtype=float).reshape(-1, 2)
    row_column = np.clip(xy_px[:, ::-1] + 0.5, 0, sonar.shape)
    return Keypoints(
        row_column=row_column,
        range_m=sonar.range_at_row(row_column[:, 0]),
        bearing_rad=sonar.bearing_at_column(row_column[:, 1]),
        response=np.ones(len(row_column)),
        descriptors=np.zeros((len(row_column), 0), dtype=np.float32),
        patches=np.zeros((0, 1, 1), dtype=np.float32),
    )


def _describe(error: Exception) -> str:
    return f"{type(error).__name__}: {quote(str(error))}"
