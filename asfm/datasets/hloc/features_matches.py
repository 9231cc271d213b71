"""Reader and writer of keypoints and matches in hloc's HDF5 files, the exchange format for external matchers.

features.h5: one group per image with ``keypoints`` (N, 2), (x, y) with pixel centres at integers, and optionally
``scores`` (N,), ``descriptors`` (D, N), ``image_size`` (width, height). matches.h5: one group name0/name1 per pair,
slashes inside a name replaced by dashes, with ``matches0`` (N0,), the index of the matched keypoint of image 1 or -1,
and optionally ``matching_scores0`` (N0,) in 0..1. hloc can write half-precision floats (as_half), which round positions
to as much as half a pixel: switch that off.
"""

from collections import abc
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asfm.datasets.hloc.hdf5 import find_groups, open_hdf5, read_array
from asfm.datasets.hloc.image_names import ImageNames
from asfm.errors import AsfmError, quote
from asfm.geometry.sonar import SonarModel
from asfm.sequence import Sequence
from asfm.types import Descriptors, ExternalMatches, FloatArray, Keypoints, Matches

MAX_OUTSIDE_PX = 1.0
"""Keypoints up to this far outside the image are moved to its border."""


def read_hloc(features_path: Path, matches_path: Path, sequence: Sequence, names: ImageNames) -> ExternalMatches:
    """Read the keypoints of every frame and the matches of the pairs of frames.

    Where a pair is stored in both directions, the one with the earlier frame first is taken.

    Args:
        features_path: features.h5.
        matches_path: matches.h5.
        sequence: the sequence of the images; its sonar model gives ranges and bearings.
        names: names of the sequence's images in the files.

    Returns:
        Keypoints of all frames, without patches, and matches sorted by frames; a cost is one minus hloc's score.

    Raises:
        AsfmError: a file is not HDF5, or a group or dataset is missing, unknown, of a wrong shape or not finite; the
            message names the file and the group.
    """
    keypoints = _read_features(features_path, sequence.sonar, names)
    counts = [len(of_frame) for of_frame in keypoints]
    return ExternalMatches(tuple(keypoints), tuple(_read_matches(matches_path, names, counts)))


def write_hloc(
    features_path: Path,
    matches_path: Path,
    names: ImageNames,
    keypoints: abc.Sequence[Keypoints],
    matches: abc.Sequence[Matches],
) -> None:
    """Write keypoints and matches in hloc's layout; a match's score is one minus its cost.

    Args:
        features_path: features.h5 to write.
        matches_path: matches.h5 to write.
        names: names of the images, one per frame.
        keypoints: of every frame.
        matches: of pairs of frames.

    Raises:
        AsfmError: a file cannot be written.
    """
    with open_hdf5(features_path, "w") as file:
        for name, of_frame in zip(names.names, keypoints, strict=True):
            group = file.create_group(name)
            group["keypoints"] = _flip_columns(of_frame.row_column, names)[:, ::-1] - 0.5
            group["scores"], group["descriptors"] = of_frame.response, of_frame.descriptors.T
            group["image_size"] = np.array(names.shape[::-1])
    with open_hdf5(matches_path, "w") as file:
        for match in matches:
            matches0 = np.full(len(keypoints[match.frame_a]), -1, dtype=np.int64)
            scores0 = np.zeros(len(matches0))
            matches0[match.index[:, 0]], scores0[match.index[:, 0]] = match.index[:, 1], 1 - match.cost
            pair = "/".join(names.names[frame].replace("/", "-") for frame in (match.frame_a, match.frame_b))
            file[f"{pair}/matches0"], file[f"{pair}/matching_scores0"] = matches0, scores0


def _read_features(path: Path, sonar: SonarModel, names: ImageNames) -> list[Keypoints]:
    """Read the keypoints of every frame, in the order of the frames."""
    frames, found = names.find_frames(), {}
    with open_hdf5(path) as file:
        for name, group in find_groups(path, file, "keypoints"):
            frame = frames.get(name)
            if frame is None:
                known = quote(names.names[0])
                raise AsfmError(f"{path}: expected images of the sequence ({known}, ...), found {quote(name)}")
            if frame in found:
                raise AsfmError(
                    f"{path}: image {quote(name)} is the second group of frame {frame}: remove one of the two"
                )
            found[frame] = _read_keypoints(f"{path}, image {quote(name)}", group, sonar, names)
    missing = sorted(set(range(len(names.names))) - set(found))
    if missing:
        raise AsfmError(
            f"{path}: expected keypoints of all {len(names.names)} images, "
            f"found none for {quote(names.names[missing[0]])}"
        )
    return [found[frame] for frame in sorted(found)]


def _read_keypoints(where: str, group: Any, sonar: SonarModel, names: ImageNames) -> Keypoints:
    """Read one group of features.h5; ``where`` names it in messages."""
    height, width = names.shape
    xy_px = read_array(where, group, "keypoints", (None, 2)).astype(float)
    count = len(xy_px)
    if "image_size" in group:
        size = read_array(where, group, "image_size", (2,)).astype(float)
        if size.tolist() != [width, height]:
            raise AsfmError(
                f"{where}: expected image_size {[width, height]}, found {size.tolist()}: keypoints of other images"
            )
    row_column = xy_px[:, ::-1] + 0.5
    outside = np.flatnonzero(
        ((row_column < -MAX_OUTSIDE_PX) | (row_column > np.add(names.shape, MAX_OUTSIDE_PX))).any(axis=1)
    )
    if len(outside):
        position = xy_px[outside[0]].tolist()
        raise AsfmError(f"{where}: keypoint {outside[0]} at {position} lies outside the {width} x {height} pixels")
    row_column = _flip_columns(np.clip(row_column, 0, names.shape), names)
    scores = read_array(where, group, "scores", (count,)) if "scores" in group else np.ones(count)
    return Keypoints(
        row_column=row_column,
        range_m=sonar.range_at_row(row_column[:, 0]),
        bearing_rad=sonar.bearing_at_column(row_column[:, 1]),
        response=scores.astype(float),
        descriptors=_read_descriptors(where, group, count),
        patches=np.zeros((0, 1, 1), dtype=np.float32),
    )


def _read_descriptors(where: str, group: Any, count: int) -> Descriptors:
    """Read (D, count) descriptors as (count, D): bytes stay bytes, other numbers become float32."""
    if "descriptors" not in group:
        return np.zeros((count, 0), dtype=np.float32)
    columns = read_array(where, group, "descriptors", (None, count))
    if columns.dtype == np.uint8:
        return np.ascontiguousarray(columns.T)
    with np.errstate(over="ignore"):
        descriptors = np.ascontiguousarray(columns.T, dtype=np.float32)
    if not np.isfinite(descriptors).all():
        raise AsfmError(f"{where}: expected descriptors within float32, found larger numbers")
    return descriptors


def _read_matches(path: Path, names: ImageNames, counts: list[int]) -> list[Matches]:
    """Read the matches of all pairs; ``counts`` are the numbers of keypoints of the frames."""
    frames = {name.replace("/", "-"): frame for name, frame in names.find_frames().items()}
    found: dict[tuple[int, int], tuple[int, Matches]] = {}
    with open_hdf5(path) as file:
        for name, group in find_groups(path, file, "matches0"):
            parts = name.split("/")
            if (
                len(parts) != 2
                or not all(part in frames for part in parts)
                or len({frames[part] for part in parts}) < 2
            ):
                raise AsfmError(
                    f"{path}: expected groups name0/name1 of two images of the sequence, found {quote(name)}"
                )
            first, second = frames[parts[0]], frames[parts[1]]
            match = _read_pair(f"{path}, pair {quote(name)}", group, first, second, counts)
            pair = (match.frame_a, match.frame_b)
            if pair not in found or first < second:
                found[pair] = (first, match)
    return [found[pair][1] for pair in sorted(found)]


def _read_pair(where: str, group: Any, first: int, second: int, counts: list[int]) -> Matches:
    """Read one group of matches.h5, and order it so that frame_a is the earlier frame."""
    partner = read_array(where, group, "matches0", (counts[first],))
    if partner.dtype.kind not in "iu":
        raise AsfmError(f"{where}: expected integers in matches0, found {partner.dtype}")
    invalid = np.flatnonzero((partner < -1) | (partner >= counts[second]))
    if len(invalid):
        raise AsfmError(
            f"{where}: matches0[{invalid[0]}] is {partner[invalid[0]]}, "
            f"expected -1 or a keypoint 0..{counts[second] - 1}"
        )
    scores: NDArray[Any] = np.ones(len(partner))
    if "matching_scores0" in group:
        scores = read_array(where, group, "matching_scores0", (counts[first],)).astype(float)
    matched = np.flatnonzero(partner >= 0)
    index, cost = np.stack([matched, partner[matched].astype(np.int64)], axis=1), 1 - scores[matched]
    if first > second:
        return Matches(second, first, np.ascontiguousarray(index[:, ::-1]), cost)
    return Matches(first, second, index, cost)


def _flip_columns(row_column: FloatArray, names: ImageNames) -> FloatArray:
    """Convert (K, 2) between columns on disk and asfm's, which run from starboard to port; an involution."""
    if not names.descending:
        return row_column
    return np.stack([row_column[:, 0], names.shape[1] - row_column[:, 1]], axis=1)
