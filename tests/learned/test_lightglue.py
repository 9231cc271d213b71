"""LightGlue: shuffled copies of features find themselves, and nothing is matched with nothing."""

import numpy as np
import pytest

from asfm.learned.aliked_lightglue import detect_aliked
from asfm.learned.disk_lightglue import detect_disk
from asfm.learned.image_features import Detect, ImageFeatures, View, detect_features
from asfm.learned.lightglue import Kind, match_by_lightglue
from tests.learned.simulated_pair import needs_extra, read_pair


def take(features: ImageFeatures, chosen: np.ndarray) -> ImageFeatures:
    return ImageFeatures(
        features.xy_px[chosen], features.warped_xy_px[chosen], features.warped_size_px, features.descriptors[chosen]
    )


@pytest.mark.parametrize("kind", ["aliked", "disk"])
def test_nothing_matches_nothing(kind: Kind) -> None:
    none = ImageFeatures(np.zeros((0, 2)), np.zeros((0, 2)), (1, 1), np.zeros((0, 1), dtype=np.float32))
    one = ImageFeatures(np.zeros((1, 2)), np.zeros((1, 2)), (64, 64), np.ones((1, 128), dtype=np.float32))
    for a, b in ((none, none), (none, one), (one, none)):
        assert match_by_lightglue(kind, a, b).shape == (0, 2)


@needs_extra
@pytest.mark.parametrize(("kind", "detect"), [("aliked", detect_aliked), ("disk", detect_disk)])
def test_shuffled_features_find_themselves(kind: Kind, detect: Detect) -> None:
    image = read_pair()[0][150:350, :160]
    features = detect_features(detect, image, np.ones(image.shape, dtype=bool), View())
    order = np.random.default_rng(0).permutation(len(features))
    index = match_by_lightglue(kind, features, take(features, order))
    assert len(index) > 0.7 * len(features) > 20
    assert (np.diff(index[:, 0]) > 0).all()
    assert (index[:, 0] == order[index[:, 1]]).mean() > 0.97
