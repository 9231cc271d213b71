"""Pictures: brightness, masks, textures and their encoding."""

import cv2
import numpy as np

from asfm.geometry.sonar import SonarModel
from asfm.types import Frame
from asfm.visualization.pictures import TEXTURE_SHAPE, brighten_image, draw_mask, encode_picture, make_texture

SONAR = SonarModel.evenly_spaced("toy", (0.5, 8.0), (-0.6, 0.5), (150, 110), 0.2)


def test_texture_is_grey_with_the_mean_brightness() -> None:
    rng = np.random.default_rng(0)
    picture = (rng.uniform(0, 60, (512, 256)) + np.linspace(0, 190, 256)).astype(np.uint8)
    small = np.frombuffer(make_texture(picture), np.uint8).reshape(*TEXTURE_SHAPE, 3)
    assert (small == small[..., :1]).all()
    blocks = picture.reshape(TEXTURE_SHAPE[0], 4, TEXTURE_SHAPE[1], 4).mean(axis=(1, 3))
    np.testing.assert_allclose(small[..., 0], blocks, atol=0.51)


def test_pictures_are_brightened_and_decode_to_the_same_values() -> None:
    image = np.tile(np.linspace(0, 1, 110, dtype=np.float32), (150, 1))
    invalid = np.zeros(SONAR.shape, bool)
    invalid[:20] = True
    picture = brighten_image(Frame(0, 0.0, image, invalid))
    assert picture.dtype == np.uint8 and picture.max() == 255 and (picture[:20] == 0).all()
    np.testing.assert_allclose((picture[20:] / 255.0) ** 2, image[20:], atol=2 / 255)
    for kind, tolerance in [("png", 0), ("jpeg", 12)]:
        data = np.frombuffer(encode_picture(kind, picture), np.uint8)
        decoded = np.asarray(cv2.imdecode(data, cv2.IMREAD_UNCHANGED), dtype=int)
        assert np.abs(decoded[30:] - picture[30:]).max() <= tolerance


def test_mask_has_an_outline_and_a_faint_filling() -> None:
    mask = np.zeros((40, 30), bool)
    mask[5:15, 4:20] = True
    mask[0, 0] = True
    opacity = draw_mask(mask)[..., 3]
    assert (opacity[~mask] == 0).all()
    assert (opacity[6:14, 5:19] == 30).all() and (opacity[5, 4:20] == 200).all() and opacity[0, 0] == 200
    assert ((opacity == 200).sum(), (opacity == 30).sum()) == (2 * 10 + 2 * 14 + 1, 8 * 14)
