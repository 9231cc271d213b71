"""Landmarks as points: colours by height, error bars and labels."""

import numpy as np
from numpy.typing import NDArray

from asfm.types import BoolArray, FloatArray, Landmarks


def colour_heights(landmarks: Landmarks) -> NDArray[np.uint8]:
    """Return (L, 3) RGB colours from blue (low) to red (high), scaled to the well constrained landmarks."""
    import cv2

    if not len(landmarks):
        return np.zeros((0, 3), np.uint8)
    low_m, high_m = find_height_range(landmarks)
    level = np.clip((landmarks.xyz_m[:, 2] - low_m) / max(high_m - low_m, 1e-6), 0, 1)
    return np.asarray(cv2.applyColorMap((255 * level).astype(np.uint8), cv2.COLORMAP_TURBO)[:, 0, ::-1])


def find_height_range(landmarks: Landmarks) -> tuple[float, float]:
    """Return the 2 % and 98 % quantiles of z (m) of the well constrained landmarks; zeros without any."""
    z_m = landmarks.xyz_m[landmarks.well_constrained, 2]
    low_m, high_m = np.percentile(z_m, [2, 98]) if len(z_m) else (0.0, 0.0)
    return float(low_m), float(high_m)


def compute_error_bars(landmarks: Landmarks, which: BoolArray) -> FloatArray:
    """Return (W, 2, 3) ends of error bars of two sigma along the least certain direction of the chosen landmarks."""
    variance_m2, axes = np.linalg.eigh(landmarks.covariance_m2[which])
    reach_m = 2 * np.sqrt(np.maximum(variance_m2[:, -1:], 0)) * axes[..., -1]
    return np.stack([landmarks.xyz_m[which] - reach_m, landmarks.xyz_m[which] + reach_m], axis=1)


def label_landmarks(landmarks: Landmarks, which: BoolArray) -> list[str]:
    """Format track, views and sigma of the chosen (L,) landmarks."""
    rows = zip(landmarks.track[which], landmarks.views[which], landmarks.sigma_m[which], strict=True)
    return [f"track {track}: {views} views, sigma {sigma_m:.3f} m" for track, views, sigma_m in rows]
