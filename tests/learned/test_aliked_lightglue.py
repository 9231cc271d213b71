"""ALIKED + LightGlue on simulated images with known motion, and its deformable convolution."""

import numpy as np
import pytest

from asfm.learned.aliked_lightglue import match_images
from asfm.types import FloatArray
from tests.learned.simulated_pair import check_matcher, check_nothing_to_match, needs_extra

pytestmark = needs_extra


@pytest.mark.parametrize("with_sonar", [True, False])
def test_most_matches_agree_with_the_motion(with_sonar: bool) -> None:
    check_matcher(match_images, with_sonar)


def test_an_image_without_echoes_has_no_matches() -> None:
    check_nothing_to_match(match_images)


def read_bilinearly(channel: FloatArray, row: float, column: float) -> float:
    """Read a pixel between its four neighbours; outside the image all is zero."""
    top, left = int(np.floor(row)), int(np.floor(column))
    total = 0.0
    for r, c in ((top, left), (top, left + 1), (top + 1, left), (top + 1, left + 1)):
        if 0 <= r < channel.shape[0] and 0 <= c < channel.shape[1]:
            total += channel[r, c] * (1 - abs(row - r)) * (1 - abs(column - c))
    return total


def convolve_slowly(image: FloatArray, offset: FloatArray, weight: FloatArray) -> FloatArray:
    """Deformable convolution by loops (Dai et al. 2017): image (C, H, W), offset (18, H, W), weight (D, C, 3, 3)."""
    result = np.zeros((len(weight), *image.shape[1:]))
    for d, y, x in np.ndindex(*result.shape):
        for c, i, j in np.ndindex(*weight.shape[1:]):
            down, right = offset[2 * (3 * i + j) : 2 * (3 * i + j) + 2, y, x]
            result[d, y, x] += weight[d, c, i, j] * read_bilinearly(image[c], y + i - 1 + down, x + j - 1 + right)
    return result


def test_deformable_convolution_equals_plain_loops() -> None:
    """ALIKED's weights were trained with the deformable convolution of torchvision, which is not needed here."""
    import torch
    from kornia.feature.aliked import deform_conv2d

    rng = np.random.default_rng(0)
    image, offset, weight = rng.normal(size=(2, 5, 6)), rng.normal(0, 1.5, (18, 5, 6)), rng.normal(size=(3, 2, 3, 3))
    tensors = [torch.from_numpy(array) for array in (image[None], offset[None], weight)]
    found = deform_conv2d(*tensors, padding=1)[0].numpy()
    assert found == pytest.approx(convolve_slowly(image, offset, weight), abs=1e-9)
