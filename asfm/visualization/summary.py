"""Summary of a run as Markdown: counts, diagnostics and legend."""

import numpy as np

from asfm.geometry.local_origin import local_origin
from asfm.sequence import Sequence
from asfm.types import FloatArray, Reconstruction
from asfm.visualization.landmarks import find_height_range


def summarise_run(sequence: Sequence, reconstruction: Reconstruction) -> str:
    """Format the counts of a run, its diagnostics and the legend of colours as Markdown."""
    landmarks, poses = reconstruction.landmarks, reconstruction.trajectory.world_from_vehicle
    length_m = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).sum()
    good = landmarks.well_constrained
    spread = f" (median sigma {np.median(landmarks.sigma_m[good]):.3f} m)" if good.any() else ""
    low_m, high_m = find_height_range(landmarks)
    heights = f" from {low_m:.2f} m (blue) to {high_m:.2f} m (red)" if high_m > low_m else ""
    diagnostics = [*sequence.diagnostics, *reconstruction.diagnostics]
    return "\n\n".join(
        [
            f"**{sequence.name}** ({sequence.sonar.name}): {len(sequence)} frames, path of {length_m:.2f} m, "
            f"{reconstruction.tracks.count} tracks, {len(landmarks)} landmarks, {good.sum()} well constrained{spread}",
            "\n".join(f"- **{item.severity.capitalize()}:** {' '.join(str(item).split())}" for item in diagnostics)
            or "No warnings.",
            "**Images**: echoes green, keypoints yellow, matches with the previous frame magenta; port is left.",
            f"**World**: points coloured by height{heights}, error bars of two sigma (hover for the value). Grey arcs: "
            "elevation not determined by the motion. Larger or brighter: in view. All trajectories start at one pose."
            + _describe_origin(poses[:, :3, 3]),
        ]
    )


def _describe_origin(xyz_m: FloatArray) -> str:
    """Say about which point the world of a path (N, 3) is drawn; nothing where that is its origin."""
    origin_m = local_origin(xyz_m)
    if not origin_m.any():
        return ""
    x, y, z = (f"{value:.0f}" for value in origin_m)
    return f" Drawn about a local origin: add ({x}, {y}, {z}) m to positions in the view for those of the world."
