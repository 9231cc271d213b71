"""Pictures of sonar images and masks: brightness, colour, size and compression."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from asfm.types import BoolArray, Frame
from asfm.visualization.colours import MASK

Picture = NDArray[Any]
JPEG_QUALITY = 60
PNG_COMPRESSION = 1
"""The fastest level."""
TEXTURE_SHAPE = (128, 64)
"""(ranges, beams) of the sonar image in the 3-D view."""


def brighten_image(frame: Frame) -> NDArray[np.uint8]:
    """Return the square root of the (ranges, beams) image as grey values, as echoes span decades; invalid: 0."""
    visible = np.sqrt(np.where(frame.invalid, 0.0, np.clip(frame.image, 0, 1)))
    return np.asarray(255 * visible).astype(np.uint8)


def draw_mask(mask: BoolArray) -> NDArray[np.uint8]:
    """Draw a (rows, columns) mask as an outline with a faint filling: (rows, columns, 4) BGRA."""
    import cv2

    filled = mask.view(np.uint8)
    inner = cv2.erode(filled, np.ones((3, 3), np.uint8), borderValue=0)
    palette = np.array([(0, 0, 0, 0), (*MASK[::-1], 200), (*MASK[::-1], 30)], np.uint8)
    return np.asarray(palette[filled + inner])


def make_texture(picture: NDArray[np.uint8]) -> bytes:
    """Resize a grey polar picture to :data:`TEXTURE_SHAPE` and return its RGB bytes."""
    import cv2

    small = cv2.resize(picture, TEXTURE_SHAPE[::-1], interpolation=cv2.INTER_AREA)
    return np.repeat(small[..., None], 3, axis=-1).tobytes()


def encode_picture(kind: str, picture: Picture) -> bytes:
    """Compress a grey or BGRA picture as "jpeg" or "png", fast rather than small."""
    import cv2

    jpeg, png = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY], [cv2.IMWRITE_PNG_COMPRESSION, PNG_COMPRESSION]
    return bytes(cv2.imencode(f".{kind}", picture, jpeg if kind == "jpeg" else png)[1])
