"""OpenCV's feature detectors behind one function: find, refine and describe the features of a picture of bytes."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from asfm.config import KeypointsConfig
from asfm.frontend.features.subpixel import refine_subpixel
from asfm.types import Descriptors, FloatArray

Picture = NDArray[np.uint8]

ORB_SCALE = 1.2
"""Each level of ORB's pyramid is this much smaller than the one before."""


@dataclass(frozen=True)
class Features:
    """What a detector found, strongest first."""

    xy_px: FloatArray
    """(K, 2) fractional column and row, pixel centres at +0.5."""
    response: FloatArray
    """(K,) in the detector's own unit."""
    descriptors: Descriptors
    """(K, D)"""


@dataclass(frozen=True)
class Detector:
    """One of OpenCV's."""

    make: Callable[[float, KeypointsConfig], Any]
    """Makes it of a threshold and the settings."""
    threshold: float
    """That of the detector unless the settings say otherwise, in its own unit."""
    weak_share: float
    """Features down to this share of the threshold fill up a picture with few; 1 where responses have another unit."""
    floor_px: float
    """Standard deviation of its best features' places, measured against the truth of simulated scenes."""
    descriptor: tuple[int, type[np.uint8] | type[np.float32]]
    """Length and type of its descriptors: bytes hold bits, compared by Hamming distance; floats, by Euclid's."""


def _make_akaze(threshold: float, settings: KeypointsConfig) -> Any:
    kind = cv2.AKAZE_DESCRIPTOR_MLDB_UPRIGHT if settings.upright else cv2.AKAZE_DESCRIPTOR_MLDB
    return cv2.AKAZE.create(kind, threshold=threshold)


def _make_orb(threshold: float, settings: KeypointsConfig) -> Any:
    return cv2.ORB.create(settings.max_count, ORB_SCALE, fastThreshold=max(round(threshold), 1))


def _make_sift(threshold: float, settings: KeypointsConfig) -> Any:
    return cv2.SIFT.create(0, 3, threshold, 10, 1.6, cv2.CV_32F, True)  # the last: no shift of the doubled image


def _make_brisk(threshold: float, settings: KeypointsConfig) -> Any:
    return cv2.BRISK.create(max(round(threshold), 1))


DETECTORS = {
    "akaze": Detector(_make_akaze, 5e-4, 0.2, 0.7, (61, np.uint8)),
    "orb": Detector(_make_orb, 5.0, 1.0, 0.8, (32, np.uint8)),
    "sift": Detector(_make_sift, 0.02, 1.0, 0.7, (128, np.float32)),
    "brisk": Detector(_make_brisk, 5.0, 1.0, 0.9, (64, np.uint8)),
}
"""Thresholds: A-KAZE's of the Hessian's determinant, SIFT's of the contrast, ORB's and BRISK's in steps of grey."""


def find_features(picture: Picture, allowed: Picture, settings: KeypointsConfig) -> Features:
    """Find the features of a picture that are strong enough, or the strongest where few are.

    Args:
        picture: (height, width).
        allowed: (height, width), non-zero where features may lie.
        settings: detector, threshold, upright, min_count and max_count are read.
    """
    found, descriptors = _detect_and_describe(picture, allowed, settings)
    if not found:
        return no_features(settings)
    response = np.array([keypoint.response for keypoint in found])
    order = np.argsort(-response, kind="stable")[: _count_kept(response, settings)]
    xy_px = np.array([keypoint.pt for keypoint in found])[order] + 0.5
    if settings.detector == "orb":
        octave = np.array([keypoint.octave for keypoint in found])[order]
        xy_px = refine_subpixel(picture, xy_px, ORB_SCALE**octave)
    chosen: Descriptors = descriptors[order]
    return Features(xy_px, response[order], chosen)


def no_features(settings: KeypointsConfig) -> Features:
    """Give an empty answer of the detector's type."""
    length, kind = DETECTORS[settings.detector].descriptor
    descriptors: Any = np.zeros((0, length), dtype=kind)
    return Features(np.zeros((0, 2)), np.zeros(0), descriptors)


def _count_kept(response: FloatArray, settings: KeypointsConfig) -> int:
    """Count the features that are strong enough, or as many as a picture shall have at least."""
    detector = DETECTORS[settings.detector]
    if detector.weak_share == 1:
        return settings.max_count
    strong = int(np.count_nonzero(response >= (settings.threshold or detector.threshold)))
    return min(max(strong, settings.min_count), settings.max_count)


def _detect_and_describe(picture: Picture, allowed: Picture, settings: KeypointsConfig) -> Any:
    """Give OpenCV's keypoints and their descriptors; upright ones are described as if none was turned.

    BRISK finds the directions anew whatever it is told.
    """
    detector = DETECTORS[settings.detector]
    finder = detector.make(detector.weak_share * (settings.threshold or detector.threshold), settings)
    if settings.detector in ("akaze", "brisk") or not settings.upright:
        return finder.detectAndCompute(picture, allowed)
    places: dict[tuple[float, ...], Any] = {}
    for keypoint in finder.detect(picture, allowed):
        keypoint.angle = 0.0
        places.setdefault((*keypoint.pt, keypoint.size), keypoint)  # SIFT gives one for each direction
    return finder.compute(picture, list(places.values())) if places else ((), None)
