"""Alignment: where the second frame shows what surrounds a keypoint of the first, and how surely.

A detector puts a feature where its own response peaks. Speckle moves that peak, and along an edge little holds it. The
patches around the two keypoints of a match tell better, and they tell how well: an edge leaves its own direction open,
a flat or much changed neighbourhood leaves both.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asfm.config import Config
from asfm.frontend.features.detectors import DETECTORS
from asfm.frontend.features.image_warp import ImageWarp, make_image_warp
from asfm.frontend.features.patches import crop_patches
from asfm.geometry.sonar import SonarModel
from asfm.types import FloatArray, ImageArray, Keypoints, Matches

LEAST_CONTRAST = 1e-6
"""Standard deviation below which a square counts as flat."""
LEAST_INFORMATION = 1e-4
"""PoseInformation that even a flat patch is said to hold about a shift in pixels: its sigma is 100 at most."""
FAR_PX = 3.0
"""A longer step than this leaves the range in which one step is right: the patch then tells nothing."""


def align_patches(patches_a: ImageArray, patches_b: ImageArray, noise_area_px: float) -> tuple[FloatArray, FloatArray]:
    """Find the shift that carries each patch of frame a onto its partner of frame b, to fractions of a pixel.

    One step of efficient second-order minimisation (Benhimane and Malis 2004): the patches, brought to mean 0 and
    standard deviation 1, differ by the mean of their gradients times the shift, to second order. Right for shifts of
    half the picture's grain or less, as matched keypoints have. The covariance is that of least squares, from what the
    shift leaves unexplained.

    Args:
        patches_a: (M, N, N), N at least 3.
        patches_b: (M, N, N).
        noise_area_px: pixels over which the noise of the image is alike.

    Returns:
        (M, 2) rows and columns by which things lie further in b than in a, (M, 2, 2) its covariance in pixels squared.
    """
    a, b = _standardise(patches_a), _standardise(patches_b)
    total, difference = a + b, (a - b)[:, 1:-1, 1:-1]
    along_rows = 0.25 * (total[:, 2:, 1:-1] - total[:, :-2, 1:-1])
    along_columns = 0.25 * (total[:, 1:-1, 2:] - total[:, 1:-1, :-2])
    both, slope = np.empty((len(a), 2, 2)), np.empty((len(a), 2, 1))
    both[:, 0, 0], both[:, 1, 1] = _dot(along_rows, along_rows), _dot(along_columns, along_columns)
    both[:, 0, 1] = both[:, 1, 0] = _dot(along_rows, along_columns)
    slope[:, 0, 0], slope[:, 1, 0] = _dot(along_rows, difference), _dot(along_columns, difference)
    inverse = np.linalg.inv(both + LEAST_INFORMATION * np.eye(2))
    shift = inverse @ slope
    left = _dot(difference, difference) - (slope * shift).sum(axis=(1, 2))
    variance = noise_area_px * np.maximum(left, 0) / (difference.shape[1] * difference.shape[2])
    return shift[..., 0], variance[:, None, None] * inverse


def align_matches(
    matches: Sequence[Matches], keypoints: Sequence[Keypoints], sonar: SonarModel, config: Config
) -> list[Matches]:
    """Tell where each match's second keypoint truly lies, as its surroundings say, and reject what unlocalised.

    Args:
        matches: of pairs of frames whose keypoints still have their patches.
        keypoints: those of every frame.
        sonar: the pixel grid.
        config: section ``localisation``, and what the patches were cut from.
    """
    image_warp, settings = make_image_warp(sonar, config.keypoints), config.localisation
    filled = [number for number, match in enumerate(matches) if len(match)]
    localised = list(matches)
    if not filled or not settings.radius_px:
        return localised
    sides = [_gather(matches[number], keypoints, image_warp, settings.radius_px) for number in filled]
    patches_a, patches_b, xy_a_px, xy_b_px = (np.concatenate(parts) for parts in zip(*sides, strict=True))
    shift, covariance = align_patches(patches_a, patches_b, _noise_area(config))
    moved = shift[:, ::-1] + (xy_a_px - np.floor(xy_a_px)) - (xy_b_px - np.floor(xy_b_px))
    near = np.hypot(*moved.T) <= FAR_PX
    floor_px = settings.floor_px or DETECTORS[config.keypoints.detector].floor_px
    covariance = settings.sigma_scale**2 * covariance[:, ::-1, ::-1] + floor_px**2 * np.eye(2)
    sigma = _polar_sigma(xy_b_px, covariance, image_warp, sonar)
    unlocalised = ~near | (np.sqrt(np.linalg.eigvalsh(covariance)[:, -1]) > settings.max_sigma_px)
    ends = np.cumsum([len(matches[number]) for number in filled])[:-1]
    for number, part, bad in zip(filled, np.split(sigma, ends), np.split(unlocalised, ends), strict=True):
        localised[number] = replace(matches[number], sigma=part).reject(bad, "unlocalised")
    return localised


def _gather(
    match: Matches, keypoints: Sequence[Keypoints], image_warp: ImageWarp, radius_px: int
) -> tuple[ImageArray, ImageArray, FloatArray, FloatArray]:
    """Give the patches and the places in the picture of both sides of a pair's matches."""
    a, b = keypoints[match.frame_a], keypoints[match.frame_b]
    of_a, of_b = match.index.T
    return (
        crop_patches(a.patches, radius_px)[of_a],
        crop_patches(b.patches, radius_px)[of_b],
        image_warp.from_polar(a.row_column)[of_a],
        image_warp.from_polar(b.row_column)[of_b],
    )


def _dot(a: NDArray[Any], b: NDArray[Any]) -> FloatArray:
    """Sum the products of (M, N, N) patches: (M,)."""
    return np.asarray(np.einsum("mij,mij->m", a, b), dtype=float)


def _standardise(patches: ImageArray) -> ImageArray:
    centred = patches - patches.mean(axis=(1, 2), keepdims=True)
    contrast = np.sqrt(_dot(centred, centred) / max(patches.shape[1] * patches.shape[2], 1))
    centred *= (1 / np.maximum(contrast, LEAST_CONTRAST)).astype(np.float32)[:, None, None]
    return np.asarray(centred, dtype=np.float32)


def _noise_area(config: Config) -> float:
    """Pixels of the blurred picture over which noise is alike: the area of a Gaussian's autocorrelation."""
    return float(max(1.0, 4 * np.pi * config.keypoints.smoothing_px**2))


def _polar_sigma(xy_px: FloatArray, covariance: FloatArray, image_warp: ImageWarp, sonar: SonarModel) -> FloatArray:
    """Return (M, 2) sigmas of range_m and bearing_rad at (M, 2) pixels with (M, 2, 2) covariances."""
    slopes = np.stack(
        [
            _to_polar(xy_px + step, image_warp, sonar) - _to_polar(xy_px - step, image_warp, sonar)
            for step in np.eye(2) / 2
        ],
        axis=2,
    )
    variance = np.einsum("mij,mjk,mik->mi", slopes, covariance, slopes)
    return np.asarray(np.sqrt(np.maximum(variance, 0)))


def _to_polar(xy_px: FloatArray, image_warp: ImageWarp, sonar: SonarModel) -> FloatArray:
    row, column = image_warp.to_polar(xy_px).T
    return np.stack([sonar.range_at_row(row), sonar.bearing_at_column(column)], axis=1)
