"""The geometry, colours and words of what is drawn of a run, whoever draws it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from asfm.poses import interpolate, invert
from asfm.sequence import Sequence
from asfm.sonar import SonarModel, back_project
from asfm.types import BoolArray, FloatArray, IntArray, Reconstruction, Tracks, Trajectory

MASK = (64, 255, 128)
SHEET_SHAPE = (128, 64)
"""(ranges, beams) of the small picture that hangs in the 3-D view."""


def anchor_trajectory(trajectory: Trajectory, estimate: Trajectory) -> FloatArray:
    """Sample a trajectory at the estimate's stamps that it covers, moved so that both agree at the first of them."""
    stamps_s = estimate.timestamps_s
    stamps_s = stamps_s[(stamps_s >= trajectory.timestamps_s[0]) & (stamps_s <= trajectory.timestamps_s[-1])]
    if not len(stamps_s):
        return np.zeros((0, 4, 4))
    poses = interpolate(trajectory.timestamps_s, trajectory.world_from_vehicle, stamps_s)
    start = interpolate(estimate.timestamps_s, estimate.world_from_vehicle, stamps_s[:1])
    return np.asarray(start @ invert(poses[:1]) @ poses)


def outline_frustum(sonar: SonarModel) -> list[FloatArray]:
    """Strips along the edges of the volume that a sonar sees, in the sonar frame."""
    bearings, elevations = np.linspace(sonar.bearing_edges_rad[0], sonar.bearing_edges_rad[-1], 33), sonar.elevations(9)
    near_far = sonar.range_edges_m[[0, -1]]
    fans = [back_project(r, bearings, phi) for r in near_far for phi in elevations[[0, -1]]]
    uprights = [back_project(r, theta, elevations) for r in near_far for theta in bearings[[0, -1]]]
    sides = [back_project(near_far, theta, phi) for theta in bearings[[0, -1]] for phi in elevations[[0, -1]]]
    return fans + uprights + sides


def tessellate_sheet(sonar: SonarModel) -> dict[str, Any]:
    """Tessellate the surface of zero elevation: positions in the sonar frame, texture coordinates, triangles."""
    rows, columns = 8, 32
    v, u = np.meshgrid(np.linspace(0, 1, rows + 1), np.linspace(0, 1, columns + 1), indexing="ij")
    range_m, bearing_rad = sonar.range_at_row(v * sonar.shape[0]), sonar.bearing_at_column(u * sonar.shape[1])
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).reshape(-1, 1)
    return {
        "vertex_positions": back_project(range_m, bearing_rad, 0.0).reshape(-1, 3),
        "vertex_texcoords": np.stack([u, v], axis=-1).reshape(-1, 2),
        "triangle_indices": (corner + np.array([0, 1, columns + 2, 0, columns + 2, columns + 1])).reshape(-1, 3),
    }


def shrink_picture(picture: NDArray[np.uint8]) -> bytes:
    """Make the small RGB texture of the sheet out of a polar picture."""
    import cv2

    small = cv2.resize(picture, SHEET_SHAPE[::-1], interpolation=cv2.INTER_AREA)
    return np.repeat(small[..., None], 3, axis=-1).tobytes()


def choose_view(sonar: SonarModel, world_from_sonar: FloatArray, seen_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Choose (eye, target): from behind, above and beside the path, far enough for the viewer's 55 degrees of view."""
    path_m = world_from_sonar[:, :3, 3]
    if not len(seen_m):  # nothing found: show how far the sonar looked
        seen_m = path_m + sonar.range_m[-1] * world_from_sonar[:, :3, 0]
    scene_m = np.concatenate([path_m, np.percentile(seen_m, [2, 98], axis=0)])
    low, high = scene_m.min(axis=0), scene_m.max(axis=0)
    ahead = world_from_sonar[:, :2, 0].mean(axis=0)
    ahead = ahead / np.hypot(*ahead) if np.hypot(*ahead) > 1e-6 else np.array([1.0, 0.0])  # the latter looks down
    direction = np.array([-ahead[0] - 0.6 * ahead[1], -ahead[1] + 0.6 * ahead[0], 0.9])
    target = (low + high) / 2
    return target + float(np.linalg.norm(high - low)) * 0.6 * direction, target


def tint_mask(mask: BoolArray) -> NDArray[np.uint8]:
    """Paint a mask as an outline with a faint filling: (rows, columns, 4) BGRA."""
    import cv2

    filled = mask.view(np.uint8)
    inner = cv2.erode(filled, np.ones((3, 3), np.uint8), borderValue=0)
    palette = np.array([(0, 0, 0, 0), (*MASK[::-1], 200), (*MASK[::-1], 30)], np.uint8)
    return np.asarray(palette[filled + inner])


def pair_steps(tracks: Tracks, xy_px: FloatArray) -> FloatArray:
    """Pair each observation with the one before it in its track, the first with itself: (O, 2, 2)."""
    here = np.arange(len(tracks))
    before = np.maximum(here - 1, 0)
    return np.stack([xy_px[np.where(tracks.track[before] == tracks.track, before, here)], xy_px], axis=1)


def choose_hues(number: IntArray) -> NDArray[np.uint8]:
    """Give each number a hue of its own, far from its neighbours' (steps of the golden ratio): (N, 3)."""
    phase = number[:, None] * 0.618034 + np.array([0.0, 1 / 3, 2 / 3])
    return np.asarray(127.5 + 127.5 * np.cos(2 * np.pi * phase)).astype(np.uint8)


def colour_heights(z_m: FloatArray) -> NDArray[np.uint8]:
    """Colour heights from blue (low) to red (high): (N, 3)."""
    import cv2

    if not len(z_m):
        return np.zeros((0, 3), np.uint8)
    low, high = np.percentile(z_m, [2, 98])
    level = np.clip((z_m - low) / max(float(high - low), 1e-6), 0, 1)
    return np.asarray(cv2.applyColorMap((255 * level).astype(np.uint8), cv2.COLORMAP_TURBO)[:, 0, ::-1])


def summarise_run(sequence: Sequence, reconstruction: Reconstruction) -> str:
    """Write the counts of a run and the meaning of the colours as Markdown."""
    landmarks, poses = reconstruction.landmarks, reconstruction.trajectory.world_from_vehicle
    length_m = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).sum()
    good = landmarks.well_constrained
    spread = f" with a median sigma of {np.median(landmarks.sigma_m[good]):.3f} m" if good.any() else ""
    return "\n\n".join(
        [
            f"**{sequence.name}** ({sequence.sonar.name}): {len(sequence)} frames, path of {length_m:.2f} m, "
            f"{reconstruction.tracks.count} tracks, {len(landmarks)} landmarks, {good.sum()} well constrained{spread}",
            "**Images**: green mask of echoes, yellow keypoints, magenta matches with the frame before, tails of "
            "tracks; port is on the fan's left",
            "**World**: blue estimate, orange odometry, green ground truth, from the same first pose; points coloured "
            "by height, larger while in view; grey arcs where the motion leaves the elevation open",
        ]
    )
