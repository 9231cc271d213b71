"""Echo mask: CFAR detections cleaned by DBSCAN and dilated by a margin."""

import cv2
import numpy as np

from asfm.config import Config
from asfm.frontend.denoising.cfar import detect_cfar
from asfm.frontend.denoising.dbscan import dbscan_mask
from asfm.types import BoolArray, Frame


def detect_echo_mask(frame: Frame, config: Config) -> BoolArray:
    """Mark the echoes of a frame: CFAR detections cleaned by DBSCAN and dilated by the margin.

    The margin keeps features on the edges of echoes inside the mask. Invalid pixels are never in it.

    Args:
        frame: image (ranges, beams) with its invalid pixels.
        config: sections ``cfar`` and ``clusters``, and ``keypoints.margin_px``.

    Returns:
        (ranges, beams) true where features may be detected.
    """
    echoes = dbscan_mask(detect_cfar(frame.amplitude, ~frame.invalid, config.cfar), config.clusters)
    margin_px = config.keypoints.margin_px
    if margin_px > 0:
        kernel = np.ones((2 * margin_px + 1, 2 * margin_px + 1), dtype=np.uint8)
        echoes = cv2.dilate(echoes.astype(np.uint8), kernel).astype(bool)
    return np.asarray(echoes & ~frame.invalid)
