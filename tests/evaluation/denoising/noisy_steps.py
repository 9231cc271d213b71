"""Grey steps with white noise, for tests of denoising."""

import numpy as np

from asfm.types import Frame, ImageArray

SHAPE = (120, 90)


def frame_of(image: ImageArray) -> Frame:
    return Frame(0, 0.0, image, np.zeros(image.shape, dtype=bool))


def draw_steps(sigma: float = 0.1) -> tuple[ImageArray, ImageArray]:
    """Draw grey steps with and without white Gaussian noise, for which the baselines are designed."""
    clean = np.full(SHAPE, 0.3, dtype=np.float32)
    clean[30:80, 20:60] = 0.7
    noisy = clean + np.random.default_rng(0).normal(scale=sigma, size=SHAPE)
    return np.clip(noisy, 0, 1).astype(np.float32), clean
