"""The 3-D part of a recording: trajectories, the moving sonar, landmarks and their elevation arcs."""

import numpy as np
from numpy.typing import NDArray

from asfm.geometry.sonar import SonarModel
from asfm.sequence import Sequence
from asfm.types import FloatArray, IntArray, Landmarks, Trajectory
from asfm.visualization import colours
from asfm.visualization.landmarks import compute_error_bars, label_landmarks
from asfm.visualization.pictures import TEXTURE_SHAPE
from asfm.visualization.rerun_stream import RerunStream
from asfm.visualization.sonar_volume import outline_frustum, tessellate_image_plane
from asfm.visualization.trajectories import collect_trajectories, measure_drift

IMAGE_PLANE_OPACITY = 110
"""Of 255: opacity of the sonar image."""


def log_trajectories(stream: RerunStream, sequence: Sequence, estimate: Trajectory) -> list[str]:
    """Log whole trajectories, their distances from ground truth, and the estimate step by step.

    Returns:
        The names of the trajectories.
    """
    trajectories = collect_trajectories(sequence, estimate)
    for name, trajectory in trajectories.items():
        xyz_m = trajectory.world_from_vehicle[:, :3, 3]
        stream.log_lines(f"world/{name}", [xyz_m], colours.TRAJECTORY[name], -1.0, static=True)
        if "groundtruth" in trajectories and name != "groundtruth":
            stream.name_curves("drift", {name: colours.TRAJECTORY[name]})
            stream.log_curve(f"drift/{name}", *measure_drift(trajectory, trajectories["groundtruth"]))
    xyz_m = estimate.world_from_vehicle[:, :3, 3]
    for index in range(1, len(xyz_m)):
        stream.set_frame(index)
        stream.log_lines("world/so_far", [xyz_m[index - 1 : index + 1]], colours.TRAJECTORY["estimate"], -1.8)
    return list(trajectories)


def log_sonar(stream: RerunStream, sonar: SonarModel, world_from_sonar: FloatArray) -> None:
    """Log the sonar's frustum and the mesh of its image once, and (N, 4, 4) poses of both."""
    rr, (height, width) = stream.rerun, TEXTURE_SHAPE
    origin = rr.Points3D([[0.0, 0.0, 0.0]], colors=colours.TRAJECTORY["estimate"], radii=-5.0)
    image_plane = rr.Mesh3D.from_fields(
        **tessellate_image_plane(sonar),
        albedo_texture_format=rr.components.ImageFormat(width, height, color_model="RGB", channel_datatype="U8"),
        albedo_factor=(255, 255, 255, IMAGE_PLANE_OPACITY),
    )
    stream.log_lines("world/sonar/frustum", outline_frustum(sonar), colours.FRUSTUM, -0.7, static=True)
    stream.log("world/sonar/origin", origin, static=True)
    stream.log("world/sonar/image", image_plane, static=True)
    for index, pose in enumerate(world_from_sonar):
        stream.set_frame(index)
        stream.log("world/sonar", rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]))


def log_landmarks(stream: RerunStream, landmarks: Landmarks, colour: NDArray[np.uint8]) -> None:
    """Log well constrained landmarks as points with error bars, and the others as elevation arcs.

    Args:
        stream: the recording.
        landmarks: L landmarks.
        colour: (L, 3) RGB.
    """
    good = landmarks.well_constrained
    labels = {"labels": label_landmarks(landmarks, good), "show_labels": False}
    points = stream.rerun.Points3D(landmarks.xyz_m[good], colors=colour[good], radii=-2.5, **labels)
    stream.log("world/points", points, static=True)
    stream.log_lines("world/points/sigma", compute_error_bars(landmarks, good), colour[good], -0.8, static=True)
    stream.log_lines("world/arcs", landmarks.arc_m[~good], colours.ARC, -0.6, static=True)


def log_landmarks_in_view(
    stream: RerunStream, landmarks: Landmarks, colour: NDArray[np.uint8], in_view: IntArray
) -> None:
    """Log the landmarks that the current frame observes, larger or brighter than the others.

    Args:
        stream: the recording.
        landmarks: L landmarks.
        colour: (L, 3) RGB.
        in_view: (V,) indices of landmarks; -1 for tracks without one.
    """
    in_view = in_view[in_view >= 0]
    good = landmarks.well_constrained[in_view]
    points, arcs = in_view[good], in_view[~good]
    points_3d = stream.rerun.Points3D(landmarks.xyz_m[points], colors=colour[points], radii=-4.5)
    stream.log("world/in_view/points", points_3d)
    stream.log_lines("world/in_view/arcs", landmarks.arc_m[arcs], colours.ARC_IN_VIEW, -0.8)
