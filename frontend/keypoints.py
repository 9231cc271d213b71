"""A-KAZE features inside the mask, found on the image stretched to near-square pixels."""

import cv2
import numpy as np

from asfm.config import Config, KeypointsConfig
from asfm.frontend.patches import cut_patches
from asfm.sonar import SonarModel
from asfm.types import BoolArray, Frame, ImageArray, Keypoints

SMALLEST_PX = 16
"""A-KAZE keeps features further than this from every border, and OpenCV's writes beyond images of one row or column."""


def detect_keypoints(frame: Frame, mask: BoolArray, sonar: SonarModel, config: Config) -> Keypoints:
    """Detect and describe features of one frame, strongest first.

    Beams are coarser than range bins on most sonars; A-KAZE's diffusion assumes square pixels, so the bearing axis is
    stretched first. Descriptors are upright: a sonar image does not turn in its own plane when the vehicle yaws, it
    shifts. Coordinates are those of the polar image.

    Args:
        frame: image of shape (ranges, beams).
        mask: (ranges, beams) where features may lie.
        sonar: the pixel grid.
        config: sections ``keypoints`` and ``ssl`` (radius of the squares) are read.
    """
    settings = config.keypoints
    stretch = column_stretch(sonar, settings)
    height, width = frame.image.shape
    if min(height, round(width * stretch)) < SMALLEST_PX:
        return _no_keypoints(config.ssl.radius_px)
    image = _stretch(_normalise_gain(frame.image, settings), stretch, cv2.INTER_LINEAR)
    allowed = _stretch(mask.astype(np.uint8), stretch, cv2.INTER_NEAREST)
    detector = cv2.AKAZE.create(cv2.AKAZE_DESCRIPTOR_MLDB_UPRIGHT, threshold=settings.threshold)
    found, descriptors = detector.detectAndCompute((image * 255).astype(np.uint8), allowed)
    if not found:
        return _no_keypoints(config.ssl.radius_px)
    response = np.array([keypoint.response for keypoint in found])
    order = np.argsort(-response, kind="stable")[: settings.max_count]
    xy_px = np.array([keypoint.pt for keypoint in found])[order] + 0.5
    row_column = np.stack([xy_px[:, 1], xy_px[:, 0] * (width / image.shape[1])], axis=1)
    return Keypoints(
        row_column=row_column,
        range_m=sonar.range_at_row(row_column[:, 0]),
        bearing_rad=sonar.bearing_at_column(row_column[:, 1]),
        response=response[order],
        descriptors=descriptors[order],
        patches=cut_patches(image, xy_px[:, ::-1], config.ssl.radius_px),
    )


def column_stretch(sonar: SonarModel, settings: KeypointsConfig) -> float:
    """Give the factor that makes a pixel at the middle range as wide as it is high, within 1..max_stretch."""
    middle_m = 0.5 * (sonar.range_edges_m[0] + sonar.range_edges_m[-1])
    return float(np.clip(middle_m * sonar.bearing_step_rad / sonar.range_step_m, 1.0, settings.max_stretch))


def _normalise_gain(image: ImageArray, settings: KeypointsConfig) -> ImageArray:
    """Smooth the speckle and scale the brightest echoes to 1, so that thresholds mean the same for every gain."""
    brightest = float(np.percentile(image, 99.5))
    if brightest <= 0:
        brightest = float(image.max()) or 1.0
    scaled = np.clip(image / np.float32(brightest), 0, 1)
    if settings.smoothing_px > 0:
        scaled = cv2.GaussianBlur(scaled, (0, 0), settings.smoothing_px)
    return np.asarray(scaled, dtype=np.float32)


def _stretch(image: ImageArray, stretch: float, interpolation: int) -> ImageArray:
    width = round(image.shape[1] * stretch)
    return np.asarray(cv2.resize(image, (width, image.shape[0]), interpolation=interpolation))


def _no_keypoints(radius_px: int) -> Keypoints:
    nothing = np.zeros(0)
    width = 2 * radius_px + 1
    return Keypoints(
        row_column=np.zeros((0, 2)),
        range_m=nothing,
        bearing_rad=nothing,
        response=nothing,
        descriptors=np.zeros((0, 61), dtype=np.uint8),
        patches=np.zeros((0, width, width), dtype=np.float32),
    )
