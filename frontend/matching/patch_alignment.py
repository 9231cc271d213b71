"""Patch alignment of matches by efficient second-order minimisation (ESM), with the covariance of the shift.

Speckle moves the peak of a detector's response, and along an edge the peak is hardly determined. Aligning the patches
of a match estimates this position uncertainty: large along an edge (aperture problem), and large in both directions
where the patches are flat or differ much.
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

MIN_CONTRAST = 1e-6
"""Lower bound of a patch's standard deviation when it is normalised: keeps flat patches finite."""
MIN_INFORMATION = 1e-4
"""Added to the information matrix of a shift in pixels, so that it is invertible for flat patches too."""
UNLOCALISED = "unlocalised"
"""Name under which matches are rejected."""
MAX_SHIFT_PX = 3.0
"""Largest shift between the keypoints; the linearisation of a single step is not valid beyond it."""


def align_patches(patches_a: ImageArray, patches_b: ImageArray, noise_area_px: float) -> tuple[FloatArray, FloatArray]:
    """Estimate the subpixel shift between the two patches of each match.

    One step of efficient second-order minimisation (Benhimane and Malis 2004): patches normalised to mean 0 and
    standard deviation 1 differ by the mean of their gradients times the shift, to second order. Valid for shifts up to
    half the correlation length of the image. The covariance is that of least squares with the residual's variance.

    Args:
        patches_a: (M, N, N), N at least 3.
        patches_b: (M, N, N).
        noise_area_px: correlation area of the image noise, in pixels.

    Returns:
        (M, 2) shifts in rows and columns from a to b, (M, 2, 2) their covariances in pixels squared.
    """
    a, b = _standardise(patches_a), _standardise(patches_b)
    summed, difference = a + b, (a - b)[:, 1:-1, 1:-1]
    along_rows = 0.25 * (summed[:, 2:, 1:-1] - summed[:, :-2, 1:-1])
    along_columns = 0.25 * (summed[:, 1:-1, 2:] - summed[:, 1:-1, :-2])
    hessian, gradient = np.empty((len(a), 2, 2)), np.empty((len(a), 2, 1))
    hessian[:, 0, 0], hessian[:, 1, 1] = _dot(along_rows, along_rows), _dot(along_columns, along_columns)
    hessian[:, 0, 1] = hessian[:, 1, 0] = _dot(along_rows, along_columns)
    gradient[:, 0, 0], gradient[:, 1, 0] = _dot(along_rows, difference), _dot(along_columns, difference)
    inverse = np.linalg.inv(hessian + MIN_INFORMATION * np.eye(2))
    shift = inverse @ gradient
    residual = _dot(difference, difference) - (gradient * shift).sum(axis=(1, 2))
    variance = noise_area_px * np.maximum(residual, 0) / (difference.shape[1] * difference.shape[2])
    return shift[..., 0], variance[:, None, None] * inverse


def align_matches(
    matches: Sequence[Matches], keypoints: Sequence[Keypoints], sonar: SonarModel, config: Config
) -> list[Matches]:
    """Estimate the position uncertainty of matched keypoints from their patches, and reject unlocalised matches.

    Args:
        matches: of pairs of frames whose keypoints have their patches.
        keypoints: those of every frame.
        sonar: the pixel grid.
        config: sections ``localisation`` and ``keypoints``.

    Returns:
        The matches in the same order, with the ``sigma`` of their keypoints in frame b.
    """
    image_warp, settings = make_image_warp(sonar, config.keypoints), config.localisation
    filled = [number for number, match in enumerate(matches) if len(match)]
    localised = list(matches)
    if not filled or not settings.radius_px:
        return localised
    sides = [_matched_patches(matches[number], keypoints, image_warp, settings.radius_px) for number in filled]
    patches_a, patches_b, xy_a_px, xy_b_px = (np.concatenate(parts) for parts in zip(*sides, strict=True))
    shift, covariance = align_patches(patches_a, patches_b, _noise_area(config))
    offset_px = shift[:, ::-1] + (xy_a_px - np.floor(xy_a_px)) - (xy_b_px - np.floor(xy_b_px))
    near = np.hypot(*offset_px.T) <= MAX_SHIFT_PX
    floor_px = settings.floor_px or DETECTORS[config.keypoints.detector].floor_px
    covariance = settings.sigma_scale**2 * covariance[:, ::-1, ::-1] + floor_px**2 * np.eye(2)
    sigma = _polar_sigma(xy_b_px, covariance, image_warp, sonar)
    unlocalised = ~near | (np.sqrt(np.linalg.eigvalsh(covariance)[:, -1]) > settings.max_sigma_px)
    ends = np.cumsum([len(matches[number]) for number in filled])[:-1]
    for number, part, bad in zip(filled, np.split(sigma, ends), np.split(unlocalised, ends), strict=True):
        localised[number] = replace(matches[number], sigma=part).reject(bad, UNLOCALISED)
    return localised


def _matched_patches(
    match: Matches, keypoints: Sequence[Keypoints], image_warp: ImageWarp, radius_px: int
) -> tuple[ImageArray, ImageArray, FloatArray, FloatArray]:
    """Return the patches (M, N, N) and the positions (M, 2) in the warped image of both keypoints of each match."""
    a, b = keypoints[match.frame_a], keypoints[match.frame_b]
    of_a, of_b = match.index.T
    return (
        crop_patches(a.patches, radius_px)[of_a],
        crop_patches(b.patches, radius_px)[of_b],
        image_warp.from_polar(a.row_column)[of_a],
        image_warp.from_polar(b.row_column)[of_b],
    )


def _dot(a: NDArray[Any], b: NDArray[Any]) -> FloatArray:
    """Return the inner products (M,) of (M, N, N) patches."""
    return np.asarray(np.einsum("mij,mij->m", a, b), dtype=float)


def _standardise(patches: ImageArray) -> ImageArray:
    """Normalise (M, N, N) patches to mean 0 and standard deviation 1."""
    centred = patches - patches.mean(axis=(1, 2), keepdims=True)
    contrast = np.sqrt(_dot(centred, centred) / max(patches.shape[1] * patches.shape[2], 1))
    centred *= (1 / np.maximum(contrast, MIN_CONTRAST)).astype(np.float32)[:, None, None]
    return np.asarray(centred, dtype=np.float32)


def _noise_area(config: Config) -> float:
    """Return the correlation area of the smoothed image's noise in pixels: that of a Gaussian's autocorrelation."""
    return float(max(1.0, 4 * np.pi * config.keypoints.smoothing_px**2))


def _polar_sigma(xy_px: FloatArray, covariance: FloatArray, image_warp: ImageWarp, sonar: SonarModel) -> FloatArray:
    """Return the standard deviations (M, 2) of range_m and bearing_rad at (M, 2) pixels of (M, 2, 2) covariances."""
    jacobian = np.stack(
        [
            _to_polar(xy_px + step, image_warp, sonar) - _to_polar(xy_px - step, image_warp, sonar)
            for step in np.eye(2) / 2
        ],
        axis=2,
    )
    variance = np.einsum("mij,mjk,mik->mi", jacobian, covariance, jacobian)
    return np.asarray(np.sqrt(np.maximum(variance, 0)))


def _to_polar(xy_px: FloatArray, image_warp: ImageWarp, sonar: SonarModel) -> FloatArray:
    """Return range_m and bearing_rad (M, 2) of (M, 2) pixels of the warped image."""
    row, column = image_warp.to_polar(xy_px).T
    return np.stack([sonar.range_at_row(row), sonar.bearing_at_column(column)], axis=1)
