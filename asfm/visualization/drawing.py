"""The geometry, colours and words of what is drawn of a run, whoever draws it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asfm.geometry.poses import interpolate, invert
from asfm.geometry.sonar import SonarModel, back_project
from asfm.sequence import Sequence
from asfm.types import (
    BoolArray,
    FloatArray,
    Frame,
    IntArray,
    Keypoints,
    Landmarks,
    Matches,
    Reconstruction,
    Tracks,
    Trajectory,
)

Picture = NDArray[Any]
JPEG_QUALITY = 60
KEYPOINT, MATCH, MASK = (255, 214, 64), (255, 64, 200), (64, 255, 128)
REJECTED = {
    "ssl": (255, 96, 64),
    "planar": (255, 160, 32),
    "clique": (200, 140, 60),
    "arc": (80, 160, 255),
    "ratio": (120, 120, 130),
    "mutual": (80, 80, 90),
}
"""Colours of the matches that each filter rejected."""
HIDDEN = tuple(f"{view}/rejected/{name}" for view in ("fan", "polar") for name in ("ratio", "mutual"))
"""What is hidden at first: most nearest descriptors of a frame are nobody's match, and would cover the picture."""
LINES = {"estimate": (64, 180, 255), "odometry": (255, 120, 80), "groundtruth": (70, 220, 110)}
LINE_NAMES = {"estimate": "estimate blue", "odometry": "odometry orange", "groundtruth": "ground truth green"}
ARC, ARC_IN_VIEW, FRUSTUM = (58, 58, 68), (140, 140, 165), (110, 130, 150)
VIEW_TANGENTS = (0.85, 0.46)
"""Half the width and height of what is in view at unit distance: 55 degrees, less a margin, and twice as wide."""
SHEET_SHAPE = (128, 64)
"""(ranges, beams) of the small picture that hangs in the 3-D view."""


@dataclass(frozen=True)
class PolarGrid:
    """The polar image as it is, with the methods of a fan."""

    sonar: SonarModel

    def pixel_at(self, range_m: FloatArray, bearing_rad: FloatArray) -> FloatArray:
        """Place (range, bearing) in the picture: (..., 2) fractional column and row."""
        return np.stack([self.sonar.column_at_bearing(bearing_rad), self.sonar.row_at_range(range_m)], axis=-1)

    def draw(self, image: Picture) -> Picture:
        """Return the polar image itself."""
        return image


def brighten_image(frame: Frame) -> NDArray[np.uint8]:
    """Make grey values of echoes: they span orders of magnitude, and the square root brings the weak ones up."""
    visible = np.sqrt(np.where(frame.invalid, 0.0, np.clip(frame.image, 0, 1)))
    return np.asarray(255 * visible).astype(np.uint8)


def sort_matches(matches: Matches) -> dict[str, tuple[IntArray, dict[str, Any]]]:
    """Sort the matches of two frames by what became of them: entity to ((M, 2) keypoints, colour and label)."""
    found: dict[str, tuple[IntArray, dict[str, Any]]] = {"matches": (matches.index, {"colors": MATCH})}
    for number, name in enumerate(matches.filters):
        index = matches.rejected[matches.rejected_by == number].astype(np.int64)
        label = {"labels": [f"rejected by {name}"] * len(index), "show_labels": False}
        found[f"rejected/{name}"] = index, {"colors": REJECTED.get(name, ARC_IN_VIEW), **label}
    return found


def join_ends(grid: Any, frame_a: Keypoints, frame_b: Keypoints, index: IntArray) -> FloatArray:
    """Draw (M, 2) matches as lines: (M, 2, 2) old and new position in the pixels of a grid."""
    ends = zip((frame_a, frame_b), index.T, strict=True)
    return np.stack([grid.pixel_at(found.range_m[which], found.bearing_rad[which]) for found, which in ends], axis=1)


def encode_picture(kind: str, picture: Picture) -> bytes:
    """Compress a grey or BGRA picture as jpeg or png, quickly rather than well."""
    import cv2

    quality = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY] if kind == "jpeg" else [cv2.IMWRITE_PNG_COMPRESSION, 1]
    return bytes(cv2.imencode(f".{kind}", picture, quality)[1])


def anchor_lines(sequence: Sequence, estimate: Trajectory) -> dict[str, Trajectory]:
    """Gather the trajectories that there are, all from the estimate's first pose, by their names in LINES."""
    named = {"estimate": estimate, "odometry": sequence.odometry, "groundtruth": sequence.groundtruth}
    lines = {name: anchor_trajectory(line, estimate) for name, line in named.items() if line is not None}
    return {name: line for name, line in lines.items() if len(line.timestamps_s)}


def anchor_trajectory(trajectory: Trajectory, estimate: Trajectory) -> Trajectory:
    """Sample a trajectory at the estimate's stamps that it covers, moved so that both agree at the first of them."""
    stamps_s = estimate.timestamps_s
    stamps_s = stamps_s[(stamps_s >= trajectory.timestamps_s[0]) & (stamps_s <= trajectory.timestamps_s[-1])]
    if not len(stamps_s):
        return Trajectory(stamps_s, np.zeros((0, 4, 4)))
    poses = interpolate(trajectory.timestamps_s, trajectory.world_from_vehicle, stamps_s)
    start = interpolate(estimate.timestamps_s, estimate.world_from_vehicle, stamps_s[:1])
    return Trajectory(stamps_s, start @ invert(poses[:1]) @ poses)


def measure_drift(trajectory: Trajectory, groundtruth: Trajectory) -> tuple[FloatArray, FloatArray]:
    """Measure how far a trajectory strays from the truth when both begin alike.

    Returns:
        The (N,) stamps of the trajectory that the truth covers, and the (N,) distances there in m.
    """
    truth = anchor_trajectory(groundtruth, trajectory)
    covered = np.isin(trajectory.timestamps_s, truth.timestamps_s)
    gap_m = trajectory.world_from_vehicle[covered, :3, 3] - truth.world_from_vehicle[:, :3, 3]
    return truth.timestamps_s, np.linalg.norm(gap_m, axis=1)


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


def shrink(picture: NDArray[np.uint8]) -> bytes:
    """Make the small RGB texture of the sheet out of a polar picture."""
    import cv2

    small = cv2.resize(picture, SHEET_SHAPE[::-1], interpolation=cv2.INTER_AREA)
    return np.repeat(small[..., None], 3, axis=-1).tobytes()


@dataclass(frozen=True)
class Outlook:
    """From where to look at a reconstruction."""

    eye_m: FloatArray
    """(3,)"""
    target_m: FloatArray
    """(3,)"""
    floor_m: float
    """Height under the scene for a grid."""


def choose_view(sonar: SonarModel, world_from_sonar: FloatArray, seen_m: FloatArray) -> Outlook:
    """Look from behind, above and beside the path, as near as path and scene allow; a few outliers are let go."""
    path_m = world_from_sonar[:, :3, 3]
    if not len(seen_m):  # nothing found: show how far the sonar looked
        seen_m = path_m + sonar.range_m[-1] * world_from_sonar[:, :3, 0]
    box_m = np.concatenate([path_m, np.percentile(seen_m, [2, 98], axis=0)])
    low_m, high_m = box_m.min(axis=0), box_m.max(axis=0)
    target_m = (low_m + high_m) / 2
    ahead = world_from_sonar[:, :2, 0].mean(axis=0)
    ahead = ahead / np.hypot(*ahead) if np.hypot(*ahead) > 1e-6 else np.array([1.0, 0.0])  # the latter looks down
    backward = np.array([-ahead[0] - 0.6 * ahead[1], -ahead[1] + 0.6 * ahead[0], 0.9])
    backward /= np.linalg.norm(backward)
    needed_m = [_distance_to_see(points_m - target_m, backward) for points_m in (path_m, seen_m)]
    distance_m = max(float(needed_m[0].max()), float(np.quantile(needed_m[1], 0.95)))
    return Outlook(target_m + distance_m * backward, target_m, float(low_m[2]))


def _distance_to_see(offset_m: FloatArray, backward: FloatArray) -> FloatArray:
    """Find how far an eye must back off from its target to have points at (N, 3) offsets from it in view: (N,)."""
    right = np.array([-backward[1], backward[0], 0.0])
    right /= np.linalg.norm(right)
    up = np.cross(backward, right)
    sides = np.stack([np.abs(offset_m @ right) / VIEW_TANGENTS[0], np.abs(offset_m @ up) / VIEW_TANGENTS[1]])
    return np.asarray(offset_m @ backward + sides.max(axis=0))


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


def split_by_frame(tracks: Tracks, frame_count: int) -> list[IntArray]:
    """Give the indices of each frame's observations."""
    by_frame = np.argsort(tracks.frame, kind="stable")
    return np.split(by_frame, np.searchsorted(tracks.frame[by_frame], np.arange(1, frame_count)))


def choose_hues(number: IntArray) -> NDArray[np.uint8]:
    """Give each number a hue of its own, far from its neighbours' (steps of the golden ratio): (N, 3)."""
    phase = number[:, None] * 0.618034 + np.array([0.0, 1 / 3, 2 / 3])
    return np.asarray(127.5 + 127.5 * np.cos(2 * np.pi * phase)).astype(np.uint8)


def colour_heights(landmarks: Landmarks) -> NDArray[np.uint8]:
    """Colour heights from blue (low) to red (high), scaled to those of the well constrained landmarks: (L, 3)."""
    import cv2

    if not len(landmarks):
        return np.zeros((0, 3), np.uint8)
    low_m, high_m = span_heights(landmarks)
    level = np.clip((landmarks.xyz_m[:, 2] - low_m) / max(high_m - low_m, 1e-6), 0, 1)
    return np.asarray(cv2.applyColorMap((255 * level).astype(np.uint8), cv2.COLORMAP_TURBO)[:, 0, ::-1])


def span_heights(landmarks: Landmarks) -> tuple[float, float]:
    """Give the lowest and highest z of the well constrained landmarks in m, a few outliers aside; zeros without any."""
    z_m = landmarks.xyz_m[landmarks.well_constrained, 2]
    low_m, high_m = np.percentile(z_m, [2, 98]) if len(z_m) else (0.0, 0.0)
    return float(low_m), float(high_m)


def draw_whiskers(landmarks: Landmarks, which: BoolArray) -> FloatArray:
    """Draw two sigma to either side of some landmarks, along the direction that is known least: (W, 2, 3)."""
    variance_m2, axes = np.linalg.eigh(landmarks.covariance_m2[which])
    reach_m = 2 * np.sqrt(np.maximum(variance_m2[:, -1:], 0)) * axes[..., -1]
    return np.stack([landmarks.xyz_m[which] - reach_m, landmarks.xyz_m[which] + reach_m], axis=1)


def name_points(landmarks: Landmarks, which: BoolArray) -> list[str]:
    """Say of some landmarks what a point alone does not show."""
    rows = zip(landmarks.track[which], landmarks.views[which], landmarks.sigma_m[which], strict=True)
    return [f"track {track}: {views} views, sigma {sigma_m:.3f} m" for track, views, sigma_m in rows]


def summarise_run(sequence: Sequence, reconstruction: Reconstruction) -> str:
    """Write the counts of a run, its warnings and the meaning of the colours as Markdown."""
    landmarks, poses = reconstruction.landmarks, reconstruction.trajectory.world_from_vehicle
    length_m = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).sum()
    good = landmarks.well_constrained
    spread = f" (median sigma {np.median(landmarks.sigma_m[good]):.3f} m)" if good.any() else ""
    low_m, high_m = span_heights(landmarks)
    heights = f" from {low_m:.2f} m (blue) to {high_m:.2f} m (red)" if high_m > low_m else ""
    diagnostics = [*sequence.diagnostics, *reconstruction.diagnostics]
    return "\n\n".join(
        [
            f"**{sequence.name}** ({sequence.sonar.name}): {len(sequence)} frames, path of {length_m:.2f} m, "
            f"{reconstruction.tracks.count} tracks, {len(landmarks)} landmarks, {good.sum()} well constrained{spread}",
            "\n".join(f"- **{item.severity.capitalize()}:** {' '.join(str(item).split())}" for item in diagnostics)
            or "No warnings.",
            "**Images**: echoes green, keypoints yellow, matches with the frame before magenta; port is left.",
            f"**World**: points coloured by height{heights}, whiskers of two sigma (hover to read it). Grey "
            "arcs: the motion leaves the elevation open. Larger or brighter: in view. All lines start from one pose.",
        ]
    )
