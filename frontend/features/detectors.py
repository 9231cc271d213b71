"""Feature detectors of OpenCV (A-KAZE, ORB, SIFT, BRISK) with one interface: detection, refinement, description."""

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
"""8-bit image in which features are detected."""

ORB_SCALE = 1.2
"""Scale factor between the levels of ORB's image pyramid."""


@dataclass(frozen=True)
class Features:
    """Features of one image, strongest first."""

    xy_px: FloatArray
    """(K, 2) fractional column and row, pixel centres at +0.5."""
    response: FloatArray
    """(K,) in the unit of the detector."""
    descriptors: Descriptors
    """(K, D)"""


@dataclass(frozen=True)
class Detector:
    """A detector of OpenCV and its defaults."""

    make: Callable[[float, KeypointsConfig], Any]
    """Constructor: OpenCV's detector from a threshold and the settings."""
    threshold: float
    """Default detection threshold, in the unit of the detector."""
    weak_threshold_ratio: float
    """Images with few features also use those above this ratio of the threshold; 1: the response has another unit."""
    floor_px: float
    """Standard deviation of the position of its best features, measured on simulated scenes with ground truth."""
    descriptor: tuple[int, type[np.uint8] | type[np.float32]]
    """Length and type of the descriptors: packed bits (Hamming distance) or floats (Euclidean distance)."""


def _make_akaze(threshold: float, settings: KeypointsConfig) -> Any:
    kind = cv2.AKAZE_DESCRIPTOR_MLDB_UPRIGHT if settings.upright else cv2.AKAZE_DESCRIPTOR_MLDB
    return cv2.AKAZE.create(kind, threshold=threshold)


def _make_orb(threshold: float, settings: KeypointsConfig) -> Any:
    return cv2.ORB.create(settings.max_count, ORB_SCALE, fastThreshold=max(round(threshold), 1))


def _make_sift(threshold: float, _settings: KeypointsConfig) -> Any:
    return cv2.SIFT.create(0, 3, threshold, 10, 1.6, cv2.CV_32F, True)  # enable_precise_upscale: no half-pixel shift


def _make_brisk(threshold: float, _settings: KeypointsConfig) -> Any:
    return cv2.BRISK.create(max(round(threshold), 1))


DETECTORS = {
    "akaze": Detector(_make_akaze, 5e-4, 0.2, 0.7, (61, np.uint8)),
    "orb": Detector(_make_orb, 5.0, 1.0, 0.8, (32, np.uint8)),
    "sift": Detector(_make_sift, 0.02, 1.0, 0.7, (128, np.float32)),
    "brisk": Detector(_make_brisk, 5.0, 1.0, 0.9, (64, np.uint8)),
}
"""Thresholds: A-KAZE on the determinant of the Hessian, SIFT on contrast, ORB and BRISK on grey level differences."""


def find_features(image: Picture, mask: Picture, settings: KeypointsConfig) -> Features:
    """Detect and describe the features above the threshold, or the strongest ones if these are fewer than min_count.

    Args:
        image: (height, width).
        mask: (height, width), non-zero where features may be detected.
        settings: detector, threshold, upright, min_count and max_count are used.

    Returns:
        At most max_count features, strongest first.
    """
    keypoints, descriptors = _detect_and_describe(image, mask, settings)
    if not keypoints:
        return no_features(settings)
    response = np.array([keypoint.response for keypoint in keypoints])
    order = np.argsort(-response, kind="stable")[: _count_kept(response, settings)]
    xy_px = np.array([keypoint.pt for keypoint in keypoints])[order] + 0.5
    if settings.detector == "orb":
        octave = np.array([keypoint.octave for keypoint in keypoints])[order]
        xy_px = refine_subpixel(image, xy_px, ORB_SCALE**octave)
    kept: Descriptors = descriptors[order]
    return Features(xy_px, response[order], kept)


def no_features(settings: KeypointsConfig) -> Features:
    """Return zero features with the descriptor length and type of the detector."""
    length, kind = DETECTORS[settings.detector].descriptor
    descriptors: Any = np.zeros((0, length), dtype=kind)
    return Features(np.zeros((0, 2)), np.zeros(0), descriptors)


def _count_kept(response: FloatArray, settings: KeypointsConfig) -> int:
    """Count the features to keep: those above the threshold, within min_count..max_count."""
    detector = DETECTORS[settings.detector]
    if detector.weak_threshold_ratio == 1:
        return settings.max_count
    strong = int(np.count_nonzero(response >= (settings.threshold or detector.threshold)))
    return min(max(strong, settings.min_count), settings.max_count)


def _detect_and_describe(image: Picture, mask: Picture, settings: KeypointsConfig) -> Any:
    """Return OpenCV's keypoints and descriptors; with ``upright`` they are described with orientation zero.

    BRISK always estimates the orientation itself.
    """
    detector = DETECTORS[settings.detector]
    opencv = detector.make(detector.weak_threshold_ratio * (settings.threshold or detector.threshold), settings)
    if settings.detector in ("akaze", "brisk") or not settings.upright:
        return opencv.detectAndCompute(image, mask)
    unique: dict[tuple[float, ...], Any] = {}
    for keypoint in opencv.detect(image, mask):
        keypoint.angle = 0.0
        unique.setdefault((*keypoint.pt, keypoint.size), keypoint)  # SIFT repeats a keypoint for each orientation
    return opencv.compute(image, list(unique.values())) if unique else ((), None)
