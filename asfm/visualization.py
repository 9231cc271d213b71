"""The recording of a run for the Rerun viewer: the only file that knows Rerun, and it loads it only when needed.

The image side shows what the front-end did frame by frame, on the fan and on the polar image; the 3-D side shows what
the back-end made of it. Radii below zero are Rerun's way to say "this many points on the screen, however far away".
"""

import subprocess
import sys
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asfm.drawing import (
    SHEET_SHAPE,
    anchor_trajectory,
    choose_hues,
    choose_view,
    colour_heights,
    outline_frustum,
    pair_steps,
    shrink_picture,
    summarise_run,
    tessellate_sheet,
    tint_mask,
)
from asfm.errors import AsfmError
from asfm.fan import FanGrid
from asfm.sequence import Sequence
from asfm.sonar import SonarModel
from asfm.types import BoolArray, FloatArray, Frame, Keypoints, Landmarks, Matches, Reconstruction, Tracks, Trajectory

FAN_WIDTH_PX, FAN_HEIGHT_PX = 600, 1000
"""The width of a fan, unless a narrow sonar would make it higher than that."""
JPEG_QUALITY = 60
TAIL_FRAMES = 10
KEYPOINT, MATCH = (255, 214, 64), (255, 64, 200)
ESTIMATE, TRUTH, ODOMETRY = (64, 180, 255), (70, 220, 110), (255, 120, 80)
ARC, FRUSTUM = (150, 150, 170, 50), (110, 130, 150)
SHEET_OPACITY = 110
"""Of the picture that hangs in the 3-D view, of 255."""


class RerunRecorder:
    """Stream a run into an .rrd file as it happens."""

    def __init__(self, path: Path, sequence: Sequence, recording_id: str = "") -> None:
        """Start a recording.

        Args:
            path: the .rrd file to write.
            sequence: what the frames and the reconstruction will be of.
            recording_id: recordings of one id merge when the viewer opens both; by default the sequence's name.

        Raises:
            AsfmError: the file cannot be written.
        """
        import rerun

        try:
            path.open("wb").close()
        except OSError as error:
            raise AsfmError(f"{path}: cannot write the recording: {error.strerror}") from None
        self._rr: Any = rerun
        self._stamps_s = sequence.timestamps_s
        sonar = sequence.sonar
        fan = FanGrid.fit(sonar, FAN_WIDTH_PX)
        if fan.height_px > FAN_HEIGHT_PX:
            fan = FanGrid.fit(sonar, max(FAN_WIDTH_PX * FAN_HEIGHT_PX // fan.height_px, 1))
        self._draw: dict[str, Callable[[NDArray[Any]], NDArray[Any]]] = {"fan": fan.draw, "polar": lambda image: image}
        self._place: dict[str, Callable[[FloatArray, FloatArray], FloatArray]] = {
            "fan": fan.pixel_at,
            "polar": lambda r, b: np.stack([sonar.column_at_bearing(b), sonar.row_at_range(r)], axis=-1),
        }
        self._stream = rerun.RecordingStream(
            "asfm",
            recording_id=recording_id or sequence.name,
            send_properties=False,
            # The clock must not decide where chunks end, nor be recorded: the same run gives the same recording.
            batcher_config=rerun.ChunkBatcherConfig(flush_tick=timedelta(days=1)),
        )
        self._stream.set_log_time_enabled(False)
        self._stream.set_log_tick_enabled(False)
        self._stream.save(path)
        self._stream.send_recording_name(sequence.name)
        self._log("world", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        self._send_blueprint(sonar, np.eye(4)[None], np.zeros((0, 3)))

    def record_frame(self, frame: Frame, mask: BoolArray, keypoints: Keypoints) -> None:
        """Draw image, mask and keypoints on the fan and on the polar image."""
        self._set_frame(frame.index)
        # Echoes span orders of magnitude: the square root brings the weak ones up.
        visible = np.sqrt(np.where(frame.invalid, 0.0, np.clip(frame.image, 0, 1)))
        picture = (255 * visible).astype(np.uint8)
        self._log("world/sonar/image", self._rr.Mesh3D.from_fields(albedo_texture_buffer=shrink_picture(picture)))
        for view, draw in self._draw.items():
            self._log(f"{view}/image", self._encode("jpeg", draw(picture)))
            self._log(f"{view}/mask", self._encode("png", tint_mask(draw(mask)), draw_order=1.0))
            xy_px = self._place[view](keypoints.range_m, keypoints.bearing_rad)
            self._log(f"{view}/keypoints", self._rr.Points2D(xy_px, colors=KEYPOINT, radii=-1.5))

    def record_matches(self, frame_a: Keypoints, frame_b: Keypoints, matches: Matches) -> None:
        """Draw each match on the later frame as a line from the old position to the new one."""
        self._set_frame(matches.frame_b)
        pairs = (frame_a, matches.index[:, 0]), (frame_b, matches.index[:, 1])
        for view, place in self._place.items():
            ends = [place(keypoints.range_m[which], keypoints.bearing_rad[which]) for keypoints, which in pairs]
            self._log(f"{view}/matches", self._rr.LineStrips2D(np.stack(ends, axis=1), colors=MATCH, radii=-1.0))

    def record_reconstruction(self, sequence: Sequence, reconstruction: Reconstruction) -> None:
        """Draw trajectories, landmarks and tracks, and write the summary and the warnings."""
        landmarks = reconstruction.landmarks
        world_from_sonar = reconstruction.trajectory.world_from_vehicle @ sequence.vehicle_from_sonar
        self._log_trajectories(sequence, reconstruction.trajectory)
        self._log_sonar(sequence.sonar, world_from_sonar)
        self._log_map(reconstruction.tracks, landmarks)
        summary = self._rr.TextDocument(summarise_run(sequence, reconstruction), media_type="text/markdown")
        self._log("summary", summary, static=True)
        self._set_frame(0)
        warnings = [(text, "WARN") for text in (*sequence.warnings, *reconstruction.warnings)]
        for text, level in warnings or [("No warnings.", "INFO")]:
            self._log("warnings", self._rr.TextLog(text, level=level))
        self._send_blueprint(sequence.sonar, world_from_sonar, landmarks.xyz_m[landmarks.well_constrained])

    def close(self) -> None:
        """Write what is still buffered and close the file."""
        self._stream.flush()
        self._stream.disconnect()

    def _log_trajectories(self, sequence: Sequence, estimate: Trajectory) -> None:
        """Draw the lines as a whole, and the estimate's once more, step by step as time goes on."""
        lines = {"estimate": (estimate, ESTIMATE), "odometry": (sequence.odometry, ODOMETRY)}
        for name, (trajectory, colour) in (lines | {"groundtruth": (sequence.groundtruth, TRUTH)}).items():
            xyz_m = anchor_trajectory(trajectory, estimate)[:, :3, 3] if trajectory is not None else np.zeros((0, 3))
            if len(xyz_m):
                self._log(f"world/{name}", self._lines_3d([xyz_m], colour, -1.0), static=True)
        xyz_m = estimate.world_from_vehicle[:, :3, 3]
        for index in range(1, len(xyz_m)):
            self._set_frame(index)
            self._log("world/so_far", self._lines_3d([xyz_m[index - 1 : index + 1]], ESTIMATE, -1.8))

    def _log_sonar(self, sonar: SonarModel, world_from_sonar: FloatArray) -> None:
        """Draw what the sonar sees as a wire frame, the image on the sheet of zero elevation, and move both."""
        rr, size = self._rr, {"height": SHEET_SHAPE[0], "width": SHEET_SHAPE[1]}
        self._log("world/sonar/frustum", self._lines_3d(outline_frustum(sonar), FRUSTUM, -0.7), static=True)
        self._log("world/sonar/origin", rr.Points3D([[0.0, 0.0, 0.0]], colors=ESTIMATE, radii=-5.0), static=True)
        layout = rr.components.ImageFormat(**size, color_model="RGB", channel_datatype="U8")
        sheet = rr.Mesh3D.from_fields(
            **tessellate_sheet(sonar), albedo_texture_format=layout, albedo_factor=(255, 255, 255, SHEET_OPACITY)
        )
        self._log("world/sonar/image", sheet, static=True)
        for index, pose in enumerate(world_from_sonar):
            self._set_frame(index)
            self._log("world/sonar", rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]))

    def _log_map(self, tracks: Tracks, landmarks: Landmarks) -> None:
        """Draw well constrained points by height, larger while in view, the others' arcs, and the tracks on the fan."""
        good = landmarks.well_constrained
        xyz_m, colours = landmarks.xyz_m[good], colour_heights(landmarks.xyz_m[good, 2])
        self._log("world/points", self._rr.Points3D(xyz_m, colors=colours, radii=-2.0), static=True)
        self._log("world/arcs", self._lines_3d(landmarks.arc_m[~good], ARC, -0.7), static=True)
        point_of_track = np.full(tracks.count, -1)
        point_of_track[landmarks.track[good]] = np.arange(len(xyz_m))
        steps, hues = (
            pair_steps(tracks, self._place["fan"](tracks.range_m, tracks.bearing_rad)),
            choose_hues(tracks.track),
        )
        by_frame = np.argsort(tracks.frame, kind="stable")
        ends = np.searchsorted(tracks.frame[by_frame], np.arange(len(self._stamps_s) + 1))
        for frame in range(len(self._stamps_s)):
            now = by_frame[ends[frame] : ends[frame + 1]]
            points = point_of_track[tracks.track[now]]
            points = points[points >= 0]
            self._set_frame(frame)
            self._log("fan/tracks", self._rr.LineStrips2D(steps[now], colors=hues[now], radii=-1.0))
            self._log("world/in_view", self._rr.Points3D(xyz_m[points], colors=colours[points], radii=-4.0))

    def _set_frame(self, index: int) -> None:
        """Move to a frame on both timelines; stamps since 1970 become dates."""
        stamp_s = float(self._stamps_s[index])
        self._stream.set_time("frame", sequence=index)
        self._stream.set_time("time", **{"timestamp" if self._stamps_s[0] > 1e8 else "duration": stamp_s})

    def _log(self, entity: str, archetype: Any, static: bool = False) -> None:
        self._stream.log(entity, archetype, static=static, strict=True)

    def _lines_3d(self, strips: Any, colour: tuple[int, ...], radius: float) -> Any:
        return self._rr.LineStrips3D(strips, colors=colour, radii=radius)

    def _encode(self, kind: str, picture: NDArray[Any], **options: float) -> Any:
        import cv2

        quality = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY] if kind == "jpeg" else [cv2.IMWRITE_PNG_COMPRESSION, 1]
        data = cv2.imencode(f".{kind}", picture, quality)[1].tobytes()
        return self._rr.EncodedImage(contents=data, media_type=f"image/{kind}", **options)

    def _send_blueprint(self, sonar: SonarModel, world_from_sonar: FloatArray, seen_m: FloatArray) -> None:
        """Arrange the views: images left, the world right, words below; open at the end, where all is drawn."""
        from rerun import blueprint as rrb

        step_s = float(np.median(np.diff(self._stamps_s))) if len(self._stamps_s) > 1 else 1.0
        tails, so_far = (_show_last(frames, step_s) for frames in (TAIL_FRAMES, None))
        fan = ["$origin/**", "- $origin/tracks"]
        images = rrb.Vertical(
            rrb.Spatial2DView(origin="fan", contents=fan, name="Fan: echoes, keypoints, matches"),
            rrb.Horizontal(
                rrb.Spatial2DView(origin="polar", name="Polar image"),
                rrb.Spatial2DView(
                    origin="fan",
                    contents=["$origin/image", "$origin/tracks"],
                    name="Fan: tracks",
                    overrides={"fan/tracks": tails},
                ),
                column_shares=[2, 3],
            ),
            row_shares=[3, 2],
        )
        position, target = choose_view(sonar, world_from_sonar, seen_m)
        eye = rrb.EyeControls3D(position=position, look_target=target, eye_up=[0.0, 0.0, 1.0])
        world = rrb.Spatial3DView(origin="world", name="World", overrides={"world/so_far": so_far}, eye_controls=eye)
        words = rrb.Horizontal(
            rrb.TextDocumentView(origin="summary", name="Summary"), rrb.TextLogView(origin="warnings", name="Warnings")
        )
        layout = rrb.Vertical(rrb.Horizontal(images, world, column_shares=[2, 3]), words, row_shares=[7, 2])
        panels = rrb.BlueprintPanel(state="collapsed"), rrb.SelectionPanel(state="collapsed")
        time = rrb.TimePanel(state="collapsed", timeline="frame", fps=10.0, play_state="following")
        self._stream.send_blueprint(rrb.Blueprint(layout, *panels, time))


def open_viewer(path: Path) -> int:
    """Show a recording in the Rerun viewer and wait until it is closed; returns the viewer's exit code.

    Raises:
        AsfmError: there is no recording at the path.
    """
    if not path.is_file():
        raise AsfmError(f"{path}: expected a recording, found no file; make one with asfm run, without --no-rerun")
    return subprocess.run([sys.executable, "-m", "rerun", str(path)], check=False).returncode


def _show_last(frames: int | None, step_s: float) -> Any:
    """Show what was logged during the last frames, or since the beginning (None), on both timelines."""
    from rerun.blueprint import TimeRangeBoundary, VisibleTimeRange, VisibleTimeRanges

    now, beginning = TimeRangeBoundary.cursor_relative(seq=0), TimeRangeBoundary.infinite()
    starts = {"frame": beginning, "time": beginning}
    if frames is not None:
        starts["frame"] = TimeRangeBoundary.cursor_relative(seq=1 - frames)
        starts["time"] = TimeRangeBoundary.cursor_relative(seconds=(0.5 - frames) * step_s)
    return VisibleTimeRanges([VisibleTimeRange(name, start=start, end=now) for name, start in starts.items()])
