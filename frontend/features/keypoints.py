"""Features inside the mask, with their places in the polar image and the patches around them."""

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

SMALLEST_PX = 16
"""Smaller images hold no feature that could be found again."""
BORDER_ROWS = 16
"""The nearest and farthest rows hold more of the sonar's own noise, which stands still, than of the scene."""
PADDING_PX = (0, 16)
"""(rows, columns) by which the picture goes on mirrored: detectors stay away from borders, but outer beams see well."""
SMALL_PX = 128
SMALL_PADDING_PX = 32
"""A side below SMALL_PX is padded by this: A-KAZE finds nothing within some 27 pixels of a border."""
SURROUNDINGS_PX = 64
"""How much of the picture around the mask a detector sees: A-KAZE takes most of the time, by the pixel, and describes
features of its first two octaves by what is so near."""


def detect_keypoints(frame: Frame, mask: BoolArray, sonar: SonarModel, config: Config) -> Keypoints:
    """Detect and describe features of one frame, strongest first.

    Beams are coarser than range bins on most sonars, and detectors assume square pixels: they look at the image
    stretched along the bearing, or at the fan. Coordinates are those of the polar image, whichever it was.

    Args:
        frame: image of shape (ranges, beams), of any gain; integers are taken for what they are.
        mask: (ranges, beams) where features may lie.
        sonar: the pixel grid.
        config: section ``keypoints`` and the radius of the patches are read.

    Raises:
        AsfmError: image, mask and sonar differ in shape, or the image holds a value that is not finite.
    """
    settings = config.keypoints
    image = _check(frame.image, mask)
    if min(image.shape) < SMALLEST_PX:
        return _no_keypoints(settings, config.patch_radius_px)
    image_warp = _open_image_warp(image, sonar, settings)
    picture = image_warp.warp(normalise_intensity(image, settings))
    features = _find_around(picture, image_warp.warp_mask(_keep_off_borders(mask)), settings)
    row_column = image_warp.to_polar(features.xy_px)
    return Keypoints(
        row_column=row_column,
        range_m=sonar.range_at_row(row_column[:, 0]),
        bearing_rad=sonar.bearing_at_column(row_column[:, 1]),
        response=features.response,
        descriptors=features.descriptors,
        patches=cut_patches(picture, image_warp.from_polar(row_column)[:, ::-1], config.patch_radius_px),
    )


def warp_image(frame: Frame, sonar: SonarModel, config: Config) -> Picture:
    """Draw the picture of bytes that the detector looks at, without what goes on beyond its borders.

    Raises:
        AsfmError: image and sonar differ in shape, or the image holds a value that is not finite.
    """
    image = _check(frame.image, frame.invalid)
    return _as_bytes(
        _open_image_warp(image, sonar, config.keypoints).warp(normalise_intensity(image, config.keypoints))
    )


def cut_keypoint_patches(frame: Frame, keypoints: Keypoints, sonar: SonarModel, config: Config) -> Keypoints:
    """Give keypoints found elsewhere the patches of the picture around them.

    Raises:
        AsfmError: image and sonar differ in shape, or the image or a place is not finite.
    """
    image = _check(frame.image, frame.invalid)
    image_warp = _open_image_warp(image, sonar, config.keypoints)
    picture = image_warp.warp(normalise_intensity(image, config.keypoints))
    xy_px = image_warp.from_polar(keypoints.row_column)
    return replace(keypoints, patches=cut_patches(picture, xy_px[:, ::-1], config.patch_radius_px))


def _keep_off_borders(mask: BoolArray) -> BoolArray:
    """Take the nearest and farthest rows out of the mask of an image that is not small."""
    if len(mask) < SMALL_PX:
        return mask
    inner = np.zeros_like(mask)
    inner[BORDER_ROWS:-BORDER_ROWS] = mask[BORDER_ROWS:-BORDER_ROWS]
    return inner


def _as_bytes(picture: ImageArray) -> Picture:
    return (picture * 255).astype(np.uint8)


def _find_around(picture: ImageArray, allowed: Picture, settings: KeypointsConfig) -> Features:
    """Find features of the part of a picture that holds all places allowed, with what surrounds them."""
    rows, columns = (_reach(np.asarray(allowed.any(axis=axis))) for axis in (1, 0))
    if rows.start == rows.stop:
        return no_features(settings)
    features = _find_padded(picture[rows, columns], allowed[rows, columns], settings)
    corner = np.array([columns.start, rows.start])
    return replace(features, xy_px=features.xy_px + corner)


def _reach(occupied: BoolArray) -> slice:
    """Give the stretch of an axis that holds what is occupied, and its surroundings."""
    places = np.flatnonzero(occupied)
    if not len(places):
        return slice(0, 0)
    return slice(max(int(places[0]) - SURROUNDINGS_PX, 0), int(places[-1]) + 1 + SURROUNDINGS_PX)


def _find_padded(picture: ImageArray, allowed: Picture, settings: KeypointsConfig) -> Features:
    """Find features of a picture that goes on mirrored beyond its borders, and take the borders off again."""
    sides = zip(picture.shape, PADDING_PX, strict=True)
    rows, columns = (SMALL_PADDING_PX if length < SMALL_PX else usual for length, usual in sides)
    border = (rows, rows, columns, columns)
    grey = cv2.copyMakeBorder(_as_bytes(picture), *border, cv2.BORDER_REFLECT)
    padded = cv2.copyMakeBorder(allowed, *border, cv2.BORDER_CONSTANT, value=0)
    features = find_features(grey, padded, settings)
    return replace(features, xy_px=np.clip(features.xy_px - (columns, rows), 0, picture.shape[::-1]))


def _check(image: ImageArray, mask: BoolArray) -> ImageArray:
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


def _open_image_warp(image: ImageArray, sonar: SonarModel, settings: KeypointsConfig) -> ImageWarp:
    if image.shape != sonar.shape:
        raise AsfmError(f"keypoints: expected an image of the sonar's {sonar.shape} pixels, found {image.shape}")
    return make_image_warp(sonar, settings)


def _no_keypoints(settings: KeypointsConfig, radius_px: int) -> Keypoints:
    nothing, width = no_features(settings), 2 * radius_px + 1
    return Keypoints(
        row_column=nothing.xy_px,
        range_m=np.zeros(0),
        bearing_rad=np.zeros(0),
        response=nothing.response,
        descriptors=nothing.descriptors,
        patches=np.zeros((0, width, width), dtype=np.float32),
    )
