"""Learned features of one sonar image: detected by a network on the stretched polar or fan image, and cached."""

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from hashlib import blake2b
from threading import Lock

import cv2
import numpy as np

from asfm.config import Config, KeypointsConfig
from asfm.errors import AsfmError
from asfm.frontend.denoising.echo_mask import detect_echo_mask
from asfm.frontend.features.image_warp import ImageWarp, StretchedPolarWarp, make_image_warp
from asfm.frontend.features.intensity import normalise_intensity
from asfm.frontend.features.keypoints import exclude_border_rows
from asfm.geometry.sonar import SonarModel
from asfm.types import BoolArray, FloatArray, Frame, ImageArray

MIN_SIDE_PX = 32
"""Smaller images have no learned features."""
MULTIPLE_PX = 32
"""The networks halve the image up to five times, so it is padded to a multiple of this."""
PADDING_PX = 16
"""Reflected padding at the side beams: networks leave out borders, but the outer beams are as good as others."""
ASSUMED_FIELD_OF_VIEW_RAD = np.pi / 2
"""Field of view where the sonar is unknown; the nearest range is taken as zero."""
MAX_CACHED = 32
"""Images whose features are kept, of all networks together."""
DEFAULT_SETTINGS = KeypointsConfig()


@dataclass(frozen=True)
class Candidates:
    """Features that a network found anywhere in an image."""

    xy_px: FloatArray
    """(K, 2) columns and rows, pixel centres at integers."""
    score: FloatArray
    """(K,) strength of detection."""
    descriptors: ImageArray
    """(K, D) of unit length."""


Detect = Callable[[ImageArray, int], Candidates]
"""Network: image (height, width) in 0..1, sides a multiple of 32, and the number of features asked for."""


@dataclass(frozen=True)
class ImageFeatures:
    """Features on the echoes of one image, strongest first."""

    xy_px: FloatArray
    """(K, 2) columns and rows of the polar image, pixel centres at integers."""
    warped_xy_px: FloatArray
    """(K, 2) columns and rows of the image that the network saw."""
    warped_size_px: tuple[int, int]
    """(width, height) of that image."""
    descriptors: ImageArray
    """(K, D) of unit length."""

    def __len__(self) -> int:
        return len(self.xy_px)


@dataclass(frozen=True)
class View:
    """What is known of the images of a pair, beside their pixels."""

    sonar: SonarModel | None = None
    """Pixel grid; without it, pixels are stretched as for a field of view of 90 degrees."""
    settings: KeypointsConfig = DEFAULT_SETTINGS
    """space, smoothing_px, max_stretch, margin_px and max_count are used."""


class FeatureCache:
    """Features of the images that were used last."""

    def __init__(self, max_count: int = MAX_CACHED) -> None:
        self._max_count = max_count
        self._found: OrderedDict[tuple[object, ...], ImageFeatures] = OrderedDict()
        self._lock = Lock()

    def provide(self, key: tuple[object, ...], detect: Callable[[], ImageFeatures]) -> ImageFeatures:
        """Return the features under a key; they are detected where they are not known."""
        with self._lock:
            if key in self._found:
                self._found.move_to_end(key)
                return self._found[key]
        features = detect()
        with self._lock:
            self._found[key] = features
            while len(self._found) > self._max_count:
                self._found.popitem(last=False)
        return features

    def __len__(self) -> int:
        return len(self._found)


CACHE = FeatureCache()
"""Features of this process: in a sequence, each image is matched with several others."""


def provide_features(detect: Detect, image: ImageArray, mask: BoolArray | None, view: View) -> ImageFeatures:
    """Return the features of an image; a second call with the same content computes nothing.

    Args:
        detect: a network.
        image: (ranges, beams) in 0..1.
        mask: (ranges, beams) true where features may lie; by default on the echoes that asfm's echo mask finds.
        view: pixel grid and settings.

    Raises:
        AsfmError: image, mask and sonar differ in shape, or a pixel is not finite.
    """
    values = _check_image(image, mask, view)
    contents = [array.tobytes() for array in (values, mask) if array is not None]
    digest = blake2b(b"".join(contents)).digest()
    key = (detect, digest, values.shape, mask is None, view.sonar, view.settings)
    return CACHE.provide(key, lambda: detect_features(detect, values, mask, view))


def provide_pair(
    detect: Detect, images: tuple[ImageArray, ImageArray], masks: tuple[BoolArray, BoolArray] | None, view: View
) -> tuple[ImageFeatures, ImageFeatures]:
    """Return the features of two images (ranges, beams); arguments and errors are those of :func:`provide_features`."""
    mask_a, mask_b = masks or (None, None)
    return provide_features(detect, images[0], mask_a, view), provide_features(detect, images[1], mask_b, view)


def detect_features(detect: Detect, image: ImageArray, mask: BoolArray | None, view: View) -> ImageFeatures:
    """Detect features of an image of shape (ranges, beams), finite; see :func:`provide_features`."""
    warp = _make_warp(image, view)
    allowed = warp.warp_mask(exclude_border_rows(_find_echoes(image, view) if mask is None else mask)) > 0
    if min(allowed.shape) < MIN_SIDE_PX or not allowed.any():
        return ImageFeatures(np.zeros((0, 2)), np.zeros((0, 2)), (1, 1), np.zeros((0, 1), dtype=np.float32))
    warped = _pad(warp.warp(normalise_intensity(image, view.settings)))
    found = detect(warped, view.settings.max_count)
    inside_px = found.xy_px - (PADDING_PX, 0)
    pixel = np.round(inside_px).astype(int)
    inside = np.asarray(((pixel >= 0) & (pixel < allowed.shape[::-1])).all(axis=1))
    inside[inside] = allowed[pixel[inside, 1], pixel[inside, 0]]
    order = np.argsort(-found.score, kind="stable")
    chosen = order[inside[order]][: view.settings.max_count]
    row_column = warp.to_polar(inside_px[chosen] + 0.5)
    return ImageFeatures(
        xy_px=np.clip(row_column[:, ::-1], 0, image.shape[::-1]) - 0.5,
        warped_xy_px=found.xy_px[chosen],
        warped_size_px=(warped.shape[1], warped.shape[0]),
        descriptors=found.descriptors[chosen],
    )


def _check_image(image: ImageArray, mask: BoolArray | None, view: View) -> ImageArray:
    """Return the image as contiguous float32."""
    values = np.ascontiguousarray(image, dtype=np.float32)
    shape = values.shape if view.sonar is None else view.sonar.shape
    if values.ndim != 2 or values.shape != shape or (mask is not None and mask.shape != shape):
        found = f"{values.shape} and {shape if mask is None else mask.shape}"
        raise AsfmError(f"learned features: expected an image and a mask of {shape} pixels, found {found}")
    if not np.isfinite(values).all():
        row, column = np.argwhere(~np.isfinite(values))[0]
        raise AsfmError(f"learned features: expected a finite image, found others, in row {row}, column {column}")
    return values


def _make_warp(image: ImageArray, view: View) -> ImageWarp:
    if view.sonar is not None:
        return make_image_warp(view.sonar, view.settings)
    if view.settings.space == "fan":
        raise AsfmError("learned features: the fan image needs the sonar's ranges and bearings, found no sonar")
    square = 0.5 * ASSUMED_FIELD_OF_VIEW_RAD * image.shape[0] / max(image.shape[1], 1)
    stretch = float(np.clip(square, 1, view.settings.max_stretch))
    return StretchedPolarWarp((image.shape[0], image.shape[1]), round(image.shape[1] * stretch))


def _find_echoes(image: ImageArray, view: View) -> BoolArray:
    frame = Frame(index=0, timestamp_s=0.0, image=image, invalid=np.zeros(image.shape, dtype=bool))
    return detect_echo_mask(frame, Config(keypoints=view.settings))


def _pad(image: ImageArray) -> ImageArray:
    """Pad by reflection: at both side beams, then at the right and the bottom up to a multiple of 32."""
    right = PADDING_PX + (-image.shape[1] - 2 * PADDING_PX) % MULTIPLE_PX
    bottom = -image.shape[0] % MULTIPLE_PX
    return np.asarray(cv2.copyMakeBorder(image, 0, bottom, PADDING_PX, right, cv2.BORDER_REFLECT))
