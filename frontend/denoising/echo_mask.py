"""Where features may lie: what stands out of the noise, without what stands alone."""

import cv2
import numpy as np

from asfm.config import Config
from asfm.frontend.denoising.cfar import detect_cfar
from asfm.frontend.denoising.dbscan import dbscan_mask
from asfm.types import BoolArray, Frame


def detect_echo_mask(frame: Frame, config: Config) -> BoolArray:
    """Mask the echoes of a frame: CFAR detections, cleaned by DBSCAN, grown by the margin.

    The margin lets features sit on the edges of the echoes. Invalid pixels are never in the mask.

    Returns:
        (ranges, beams).
    """
    echoes = dbscan_mask(detect_cfar(frame.amplitude, ~frame.invalid, config.cfar), config.clusters)
    margin_px = config.keypoints.margin_px
    if margin_px > 0:
        square = np.ones((2 * margin_px + 1, 2 * margin_px + 1), dtype=np.uint8)
        echoes = cv2.dilate(echoes.astype(np.uint8), square).astype(bool)
    return np.asarray(echoes & ~frame.invalid)
