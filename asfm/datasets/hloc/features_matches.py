"""Keypoints and matches in the HDF5 files of hloc, so that any matcher that writes them can be used and judged.

features.h5: a group an image with ``keypoints`` (N, 2), column and row with pixel centres at whole numbers, and
perhaps ``scores`` (N,), ``descriptors`` (D, N), ``image_size`` (width, height). matches.h5: a group name0/name1, a
slash inside a name being written as a dash, with ``matches0`` (N0,), the keypoint of image 1 or -1, and perhaps
``matching_scores0`` (N0,) in 0..1. hloc can write floats in half precision (as_half): places then lie on a grid of up
to half a pixel, so switch that off.
"""

from collections.abc import Sequence as Many
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asfm.datasets.hloc.hdf5 import open_hdf5, read_array, walk_groups
from asfm.datasets.hloc.image_names import ImageNames
from asfm.errors import AsfmError
from asfm.geometry.sonar import SonarModel
from asfm.sequence import Sequence
from asfm.types import Descriptors, ExternalMatches, FloatArray, Keypoints, Matches

OUTSIDE_PX = 1.0
"""Detectors may place a keypoint this far outside the image; it is moved to the border."""


def read_hloc(features: Path, matches: Path, sequence: Sequence, names: ImageNames) -> ExternalMatches:
    """Read the keypoints of every frame and the matches of all pairs of frames.

    Of a pair that is there in both directions the one with the earlier frame first is taken.

    Raises:
        AsfmError: a file is not HDF5 or a group or dataset is missing, unknown, of a wrong shape or not finite; the
            message names the file and the group.
    """
    keypoints = _read_features(features, sequence.sonar, names)
    return ExternalMatches(tuple(keypoints), tuple(_read_matches(matches, names, [len(each) for each in keypoints])))


def write_hloc(
    features: Path, matches: Path, names: ImageNames, keypoints: Many[Keypoints], found: Many[Matches]
) -> None:
    """Write keypoints and matches as hloc lays them out; a match's score is one minus its cost."""
    with open_hdf5(features, "w") as file:
        for name, each in zip(names.names, keypoints, strict=True):
            group = file.create_group(name)
            group["keypoints"] = _turn(each.row_column, names)[:, ::-1] - 0.5
            group["scores"], group["descriptors"] = each.response, each.descriptors.T
            group["image_size"] = np.array(names.shape[::-1])
    with open_hdf5(matches, "w") as file:
        for match in found:
            matches0 = np.full(len(keypoints[match.frame_a]), -1, dtype=np.int64)
            scores0 = np.zeros(len(matches0))
            matches0[match.index[:, 0]], scores0[match.index[:, 0]] = match.index[:, 1], 1 - match.cost
            pair = "/".join(names.names[frame].replace("/", "-") for frame in (match.frame_a, match.frame_b))
            file[f"{pair}/matches0"], file[f"{pair}/matching_scores0"] = matches0, scores0


def _read_features(path: Path, sonar: SonarModel, names: ImageNames) -> list[Keypoints]:
    frames, found = names.find_frames(), {}
    with open_hdf5(path) as file:
        for name, group in walk_groups(path, file, "keypoints"):
            frame = frames.get(name)
            if frame is None:
                raise AsfmError(f"{path}: image {name!r} is none of the sequence's, {names.names[0]!r} and so on")
            if frame in found:
                raise AsfmError(f"{path}: image {name!r} is there twice, under two names of frame {frame}")
            found[frame] = _read_keypoints(f"{path}, image {name!r}", group, sonar, names)
    missing = sorted(set(range(len(names.names))) - set(found))
    if missing:
        raise AsfmError(
            f"{path}: expected keypoints of all {len(names.names)} images, found none of {names.names[missing[0]]!r}"
        )
    return [found[frame] for frame in sorted(found)]


def _read_keypoints(where: str, group: Any, sonar: SonarModel, names: ImageNames) -> Keypoints:
    height, width = names.shape
    xy_px = read_array(where, group, "keypoints", (None, 2)).astype(float)
    count = len(xy_px)
    if "image_size" in group:
        size = read_array(where, group, "image_size", (2,)).astype(float)
        if size.tolist() != [width, height]:
            raise AsfmError(f"{where}: expected image_size {[width, height]}, found {size.tolist()}: another image?")
    row_column = xy_px[:, ::-1] + 0.5
    outside = np.flatnonzero(((row_column < -OUTSIDE_PX) | (row_column > np.add(names.shape, OUTSIDE_PX))).any(axis=1))
    if len(outside):
        place = xy_px[outside[0]].tolist()
        raise AsfmError(f"{where}: keypoint {outside[0]} at {place} lies outside the {width} x {height} pixels")
    row_column = _turn(np.clip(row_column, 0, names.shape), names)
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
    if "descriptors" not in group:
        return np.zeros((count, 0), dtype=np.float32)
    columns = read_array(where, group, "descriptors", (None, count))
    if columns.dtype == np.uint8:
        return np.ascontiguousarray(columns.T)
    return np.ascontiguousarray(columns.T, dtype=np.float32)


def _read_matches(path: Path, names: ImageNames, counts: list[int]) -> list[Matches]:
    frames = {name.replace("/", "-"): frame for name, frame in names.find_frames().items()}
    found: dict[tuple[int, int], tuple[int, Matches]] = {}
    with open_hdf5(path) as file:
        for name, group in walk_groups(path, file, "matches0"):
            parts = name.split("/")
            if (
                len(parts) != 2
                or not all(part in frames for part in parts)
                or len({frames[part] for part in parts}) < 2
            ):
                raise AsfmError(f"{path}: expected groups name0/name1 of two of the sequence's images, found {name!r}")
            first, second = frames[parts[0]], frames[parts[1]]
            match = _read_pair(f"{path}, pair {name!r}", group, first, second, counts)
            pair = (match.frame_a, match.frame_b)
            if pair not in found or first < second:
                found[pair] = (first, match)
    return [found[pair][1] for pair in sorted(found)]


def _read_pair(where: str, group: Any, first: int, second: int, counts: list[int]) -> Matches:
    partner = read_array(where, group, "matches0", (counts[first],))
    if partner.dtype.kind not in "iu":
        raise AsfmError(f"{where}: expected whole numbers in matches0, found {partner.dtype}")
    wrong = np.flatnonzero((partner < -1) | (partner >= counts[second]))
    if len(wrong):
        raise AsfmError(
            f"{where}: matches0[{wrong[0]}] is {partner[wrong[0]]}, expected -1 or a keypoint 0..{counts[second] - 1}"
        )
    scores: NDArray[Any] = np.ones(len(partner))
    if "matching_scores0" in group:
        scores = read_array(where, group, "matching_scores0", (counts[first],)).astype(float)
    matched = np.flatnonzero(partner >= 0)
    index, cost = np.stack([matched, partner[matched].astype(np.int64)], axis=1), 1 - scores[matched]
    if first > second:
        return Matches(second, first, np.ascontiguousarray(index[:, ::-1]), cost)
    return Matches(first, second, index, cost)


def _turn(row_column: FloatArray, names: ImageNames) -> FloatArray:
    """Go between columns on disk and asfm's, which run from starboard to port; its own inverse."""
    if not names.descending:
        return row_column
    return np.stack([row_column[:, 0], names.shape[1] - row_column[:, 1]], axis=1)
