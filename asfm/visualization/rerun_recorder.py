"""Rerun recording of a run: images with keypoints, matches and tracks, and the map in 3-D."""

from pathlib import Path
from typing import Any

import numpy as np

from asfm.geometry.fan import FanGrid
from asfm.geometry.local_origin import local_origin, shift_reconstruction
from asfm.sequence import Sequence
from asfm.types import BoolArray, Frame, Keypoints, Landmarks, Matches, Reconstruction, Tracks
from asfm.visualization import colours
from asfm.visualization.blueprint import build_blueprint
from asfm.visualization.landmarks import colour_heights
from asfm.visualization.overlays import (
    Grid,
    PolarGrid,
    build_match_segments,
    build_track_segments,
    group_matches,
)
from asfm.visualization.pictures import Picture, brighten_image, draw_mask, encode_picture, make_texture
from asfm.visualization.rerun_stream import RerunStream
from asfm.visualization.summary import summarise_run
from asfm.visualization.viewpoint import Viewpoint, choose_viewpoint
from asfm.visualization.world import log_landmarks, log_landmarks_in_view, log_sonar, log_trajectories

FAN_WIDTH_PX, MAX_FAN_HEIGHT_PX = 600, 1000
"""A fan has this width, or less where a narrow sonar would make it higher than the maximum."""


class RerunRecorder:
    """Recorder that streams a run into an .rrd file."""

    def __init__(self, path: Path, sequence: Sequence, recording_id: str = "") -> None:
        """Start a recording.

        Args:
            path: the .rrd file to write.
            sequence: the sequence of the frames and of the reconstruction.
            recording_id: the viewer merges recordings of one id; by default the name of the sequence.

        Raises:
            AsfmError: the file cannot be written.
        """
        self._stamps_s = sequence.timestamps_s
        self._grids: dict[str, Grid] = {
            "fan": FanGrid.fit(sequence.sonar, FAN_WIDTH_PX, MAX_FAN_HEIGHT_PX),
            "polar": PolarGrid(sequence.sonar),
        }
        self._stream = RerunStream(path, sequence.name, recording_id or sequence.name, self._stamps_s)
        self._rr = self._stream.rerun
        self._stream.log("world", self._rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        counts = {"keypoints": colours.KEYPOINT, "matches": colours.MATCH, "tracks": colours.MASK}
        self._stream.name_curves("counts", counts)
        self._send_blueprint(choose_viewpoint(sequence.sonar, np.eye(4)[None], np.zeros((0, 3))), [])

    def record_frame(self, frame: Frame, mask: BoolArray, keypoints: Keypoints) -> None:
        """Log image, mask and keypoints on the fan and on the polar image."""
        self._stream.set_frame(frame.index)
        picture = brighten_image(frame)
        texture = self._rr.Mesh3D.from_fields(albedo_texture_buffer=make_texture(picture))
        self._stream.log("world/sonar/image", texture)
        for view, grid in self._grids.items():
            self._stream.log(f"{view}/image", self._encode("jpeg", grid.draw(picture)))
            self._stream.log(f"{view}/mask", self._encode("png", draw_mask(grid.draw(mask)), draw_order=1.0))
            xy_px = grid.pixel_at(keypoints.range_m, keypoints.bearing_rad)
            self._stream.log(f"{view}/keypoints", self._rr.Points2D(xy_px, colors=colours.KEYPOINT, radii=-1.5))
        self._stream.log("counts/keypoints", self._rr.Scalars(len(keypoints)))

    def record_matches(self, frame_a: Keypoints, frame_b: Keypoints, matches: Matches) -> None:
        """Log accepted and rejected matches on the later frame, as segments from the old to the new position."""
        self._stream.set_frame(matches.frame_b)
        for name, (index, style) in group_matches(matches).items():
            for view, grid in self._grids.items():
                segments = build_match_segments(grid, frame_a, frame_b, index)
                self._stream.log(f"{view}/{name}", self._rr.LineStrips2D(segments, radii=-1.0, **style))
        self._stream.log("counts/matches", self._rr.Scalars(len(matches)))

    def record_reconstruction(self, sequence: Sequence, reconstruction: Reconstruction) -> None:
        """Log trajectories, landmarks, tracks and the summary, about a local origin, as Rerun rounds to float32."""
        summary = self._rr.TextDocument(summarise_run(sequence, reconstruction), media_type="text/markdown")
        self._stream.log("summary", summary, static=True)
        origin_m = local_origin(reconstruction.trajectory.world_from_vehicle[:, :3, 3])
        reconstruction = shift_reconstruction(reconstruction, -origin_m)
        landmarks = reconstruction.landmarks
        world_from_sonar = reconstruction.trajectory.world_from_vehicle @ sequence.vehicle_from_sonar
        trajectories = log_trajectories(self._stream, sequence, reconstruction.trajectory)
        log_sonar(self._stream, sequence.sonar, world_from_sonar)
        self._log_map(reconstruction.tracks, landmarks)
        self._send_blueprint(choose_viewpoint(sequence.sonar, world_from_sonar, landmarks.xyz_m), trajectories)

    def close(self) -> None:
        """Write all buffered data and close the file.

        Raises:
            AsfmError: not all data could be written, for example on a full disk.
        """
        self._stream.close()

    def _log_map(self, tracks: Tracks, landmarks: Landmarks) -> None:
        """Log the landmarks and, frame by frame, the tracks on the fan and the landmarks in view."""
        colour = colour_heights(landmarks)
        log_landmarks(self._stream, landmarks, colour)
        landmark_of_track = np.full(tracks.count, -1)
        landmark_of_track[landmarks.track] = np.arange(len(landmarks))
        segments = build_track_segments(tracks, self._grids["fan"].pixel_at(tracks.range_m, tracks.bearing_rad))
        hues = colours.choose_hues(tracks.track)
        for frame, now in enumerate(tracks.by_frame(len(self._stamps_s))):
            self._stream.set_frame(frame)
            self._stream.log("counts/tracks", self._rr.Scalars(len(now)))
            self._stream.log("fan/tracks", self._rr.LineStrips2D(segments[now], colors=hues[now], radii=-1.0))
            log_landmarks_in_view(self._stream, landmarks, colour, landmark_of_track[tracks.track[now]])

    def _encode(self, kind: str, picture: Picture, **options: float) -> Any:
        data = encode_picture(kind, picture)
        return self._rr.EncodedImage(contents=data, media_type=f"image/{kind}", **options)

    def _send_blueprint(self, viewpoint: Viewpoint, trajectories: list[str]) -> None:
        step_s = float(np.median(np.diff(self._stamps_s))) if len(self._stamps_s) > 1 else 1.0
        self._stream.send_blueprint(build_blueprint(viewpoint, trajectories, step_s))
