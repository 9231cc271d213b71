"""Keypoint detection: features inside the echo mask, in polar image coordinates, with descriptors and patches."""

from dataclasses import replace

import cv2
import numpy as np

from asfm.config import Config, KeypointsConfig
from asfm.errors import AsfmError
from asfm.frontend.features.detectors import Features, Picture, find_features, no_features
from asfm.frontend.features.image_warp import ImageWarp, make_image_warp
from asfm.frontend.features.intensity import normalise_intensity
from asfm.frontend.features.patches import cut_patches
from asfm.geometry.sonar import SonarModel
from asfm.types import BoolArray, Frame, ImageArray, Keypoints

MIN_SIDE_PX = 16
"""Smaller images have no repeatable features."""
BORDER_ROWS = 16
"""Nearest and farthest rows without features: they hold more static noise of the sonar itself than of the scene."""
PADDING_PX = (0, 16)
"""(rows, columns) of reflected padding: detectors leave out borders, but the outer beams are as good as others."""
SMALL_SIDE_PX = 128
SMALL_PADDING_PX = 32
"""Padding of a side below SMALL_SIDE_PX: A-KAZE detects nothing within about 27 pixels of a border."""
CROP_MARGIN_PX = 64
"""Margin of the crop around the mask. The time of A-KAZE is proportional to the pixels, and the descriptors of its
first two octaves reach no farther."""


def detect_keypoints(frame: Frame, mask: BoolArray, sonar: SonarModel, config: Config) -> Keypoints:
    """Detect and describe the features of one frame, strongest first.

    Beams are coarser than range bins on most sonars and detectors assume square pixels, so features are detected in a
    warped image (see ``image_warp``). Their coordinates are those of the polar image in either case.

    Args:
        frame: image of shape (ranges, beams) with any gain; integer pixels are not rescaled.
        mask: (ranges, beams) true where features may be detected.
        sonar: pixel grid of the image.
        config: section ``keypoints`` and ``patch_radius_px`` are used.

    Returns:
        Keypoints with descriptors and patches.

    Raises:
        AsfmError: image, mask and sonar differ in shape, or a pixel is not finite.
    """
    settings = config.keypoints
    image = _check_image(frame.image, mask)
    if min(image.shape) < MIN_SIDE_PX:
        return _no_keypoints(settings, config.patch_radius_px)
    image_warp = _image_warp_of(image, sonar, settings)
    warped = image_warp.warp(normalise_intensity(image, settings))
    features = _find_in_mask(warped, image_warp.warp_mask(exclude_border_rows(mask)), settings)
    row_column = image_warp.to_polar(features.xy_px)
    return Keypoints(
        row_column=row_column,
        range_m=sonar.range_at_row(row_column[:, 0]),
        bearing_rad=sonar.bearing_at_column(row_column[:, 1]),
        response=features.response,
        descriptors=features.descriptors,
        patches=cut_patches(warped, image_warp.from_polar(row_column)[:, ::-1], config.patch_radius_px),
    )


def warp_image(frame: Frame, sonar: SonarModel, config: Config) -> Picture:
    """Return the normalised and warped 8-bit image (height, width) in which features are detected, without padding.

    Raises:
        AsfmError: image and sonar differ in shape, or a pixel is not finite.
    """
    image = _check_image(frame.image, frame.invalid)
    image_warp = _image_warp_of(image, sonar, config.keypoints)
    return _to_8_bit(image_warp.warp(normalise_intensity(image, config.keypoints)))


def cut_keypoint_patches(frame: Frame, keypoints: Keypoints, sonar: SonarModel, config: Config) -> Keypoints:
    """Cut the patches of keypoints that were detected elsewhere, from the normalised and warped image.

    Args:
        frame: image of shape (ranges, beams) that the keypoints belong to.
        keypoints: K keypoints; their patches are replaced.
        sonar: pixel grid of the image.
        config: section ``keypoints`` and ``patch_radius_px`` are used.

    Returns:
        The keypoints with (K, 2r+1, 2r+1) patches.

    Raises:
        AsfmError: image and sonar differ in shape, or a pixel or a position is not finite.
    """
    image = _check_image(frame.image, frame.invalid)
    image_warp = _image_warp_of(image, sonar, config.keypoints)
    warped = image_warp.warp(normalise_intensity(image, config.keypoints))
    xy_px = image_warp.from_polar(keypoints.row_column)
    return replace(keypoints, patches=cut_patches(warped, xy_px[:, ::-1], config.patch_radius_px))


def exclude_border_rows(mask: BoolArray) -> BoolArray:
    """Remove the nearest and farthest rows from a (ranges, beams) mask, unless the image is small."""
    if len(mask) < SMALL_SIDE_PX:
        return mask
    inner = np.zeros_like(mask)
    inner[BORDER_ROWS:-BORDER_ROWS] = mask[BORDER_ROWS:-BORDER_ROWS]
    return inner


def _to_8_bit(image: ImageArray) -> Picture:
    return (image * 255).astype(np.uint8)


def _find_in_mask(image: ImageArray, mask: Picture, settings: KeypointsConfig) -> Features:
    """Detect features in the bounding box of the mask with a margin; positions are those in the whole image."""
    rows, columns = (_occupied_slice(np.asarray(mask.any(axis=axis))) for axis in (1, 0))
    if rows.start == rows.stop:
        return no_features(settings)
    features = _find_padded(image[rows, columns], mask[rows, columns], settings)
    corner = np.array([columns.start, rows.start])
    return replace(features, xy_px=features.xy_px + corner)


def _occupied_slice(occupied: BoolArray) -> slice:
    """Return the slice of an axis from the first to the last true element, with the margin of the crop."""
    indices = np.flatnonzero(occupied)
    if not len(indices):
        return slice(0, 0)
    return slice(max(int(indices[0]) - CROP_MARGIN_PX, 0), int(indices[-1]) + 1 + CROP_MARGIN_PX)


def _find_padded(image: ImageArray, mask: Picture, settings: KeypointsConfig) -> Features:
    """Detect features in the image with reflected padding; positions are those in the image without it."""
    sides = zip(image.shape, PADDING_PX, strict=True)
    rows, columns = (SMALL_PADDING_PX if length < SMALL_SIDE_PX else padding for length, padding in sides)
    border = (rows, rows, columns, columns)
    padded = cv2.copyMakeBorder(_to_8_bit(image), *border, cv2.BORDER_REFLECT)
    padded_mask = cv2.copyMakeBorder(mask, *border, cv2.BORDER_CONSTANT, value=0)
    features = find_features(padded, padded_mask, settings)
    return replace(features, xy_px=np.clip(features.xy_px - (columns, rows), 0, image.shape[::-1]))


def _check_image(image: ImageArray, mask: BoolArray) -> ImageArray:
    if image.ndim != 2 or mask.shape != image.shape:
        raise AsfmError(
            f"keypoints: expected an image (ranges, beams) and a mask of the same shape, "
            f"found {image.shape} and {mask.shape}"
        )
    values = np.asarray(image, dtype=np.float32)
    if not np.isfinite(values).all():
        row, column = np.argwhere(~np.isfinite(values))[0]
        raise AsfmError(f"keypoints: expected a finite image, found {image[row, column]} in row {row}, column {column}")
    return values


def _image_warp_of(image: ImageArray, sonar: SonarModel, settings: KeypointsConfig) -> ImageWarp:
    if image.shape != sonar.shape:
        raise AsfmError(f"keypoints: expected an image of the sonar's {sonar.shape} pixels, found {image.shape}")
    return make_image_warp(sonar, settings)


def _no_keypoints(settings: KeypointsConfig, radius_px: int) -> Keypoints:
    empty, width = no_features(settings), 2 * radius_px + 1
    return Keypoints(
        row_column=empty.xy_px,
        range_m=np.zeros(0),
        bearing_rad=np.zeros(0),
        response=empty.response,
        descriptors=empty.descriptors,
        patches=np.zeros((0, width, width), dtype=np.float32),
    )
