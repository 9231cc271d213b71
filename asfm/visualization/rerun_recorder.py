"""The recording of a run for the Rerun viewer: the only file that knows Rerun, and it loads it only when needed.

The image side shows what the front-end did frame by frame, on the fan and on the polar image; the 3-D side shows what
the back-end made of it. Radii below zero are Rerun's way to say "this many points on the screen, however far away".
"""

import subprocess
import sys
from collections.abc import Iterable
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asfm.errors import AsfmError
from asfm.geometry.fan import FanGrid
from asfm.geometry.sonar import SonarModel
from asfm.sequence import Sequence
from asfm.types import BoolArray, FloatArray, Frame, Keypoints, Landmarks, Matches, Reconstruction, Tracks, Trajectory
from asfm.visualization import drawing

FAN_WIDTH_PX, FAN_HEIGHT_PX = 600, 1000
"""The width of a fan, unless a narrow sonar would make it higher than that."""
FOUND = "Fan: echoes, keypoints, matches"
TAIL_FRAMES = 10
SHEET_OPACITY = 110
"""Of the picture that hangs in the 3-D view, of 255."""
FLUSH_S, PATIENT_FLUSH_S = 5.0, 60.0
"""How long to wait for the recording to be written, at first and once more."""


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
        self._path = path
        self._rr: Any = rerun
        self._stamps_s = sequence.timestamps_s
        sonar = sequence.sonar
        self._grids: dict[str, FanGrid | drawing.PolarGrid] = {
            "fan": FanGrid.fit(sonar, FAN_WIDTH_PX, FAN_HEIGHT_PX),
            "polar": drawing.PolarGrid(sonar),
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
        try:
            self._stream.save(path)
        except RuntimeError as error:
            raise AsfmError(f"{path}: cannot write the recording: {' '.join(str(error).split())}") from None
        self._stream.send_recording_name(sequence.name)
        self._log("world", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        self._name_curves("counts", {"keypoints": drawing.KEYPOINT, "matches": drawing.MATCH, "tracks": drawing.MASK})
        self._send_blueprint(drawing.choose_view(sonar, np.eye(4)[None], np.zeros((0, 3))))

    def record_frame(self, frame: Frame, mask: BoolArray, keypoints: Keypoints) -> None:
        """Draw image, mask and keypoints on the fan and on the polar image."""
        self._set_frame(frame.index)
        picture = drawing.brighten_image(frame)
        self._log("world/sonar/image", self._rr.Mesh3D.from_fields(albedo_texture_buffer=drawing.shrink(picture)))
        for view, grid in self._grids.items():
            self._log(f"{view}/image", self._encode("jpeg", grid.draw(picture)))
            self._log(f"{view}/mask", self._encode("png", drawing.tint_mask(grid.draw(mask)), draw_order=1.0))
            xy_px = grid.pixel_at(keypoints.range_m, keypoints.bearing_rad)
            self._log(f"{view}/keypoints", self._rr.Points2D(xy_px, colors=drawing.KEYPOINT, radii=-1.5))
        self._log("counts/keypoints", self._rr.Scalars(len(keypoints)))

    def record_matches(self, frame_a: Keypoints, frame_b: Keypoints, matches: Matches) -> None:
        """Draw each match on the later frame as a line from the old position to the new one, and those rejected."""
        self._set_frame(matches.frame_b)
        for name, (index, hints) in drawing.sort_matches(matches).items():
            for view, grid in self._grids.items():
                ends = drawing.join_ends(grid, frame_a, frame_b, index)
                self._log(f"{view}/{name}", self._rr.LineStrips2D(ends, radii=-1.0, **hints))
        self._log("counts/matches", self._rr.Scalars(len(matches)))

    def record_reconstruction(self, sequence: Sequence, reconstruction: Reconstruction) -> None:
        """Draw trajectories, landmarks and tracks, and write the summary."""
        landmarks = reconstruction.landmarks
        world_from_sonar = reconstruction.trajectory.world_from_vehicle @ sequence.vehicle_from_sonar
        lines = self._log_trajectories(sequence, reconstruction.trajectory)
        self._log_sonar(sequence.sonar, world_from_sonar)
        self._log_map(reconstruction.tracks, landmarks)
        summary = self._rr.TextDocument(drawing.summarise_run(sequence, reconstruction), media_type="text/markdown")
        self._log("summary", summary, static=True)
        outlook = drawing.choose_view(sequence.sonar, world_from_sonar, landmarks.xyz_m)
        self._send_blueprint(outlook, lines)

    def close(self) -> None:
        """Write what is still buffered and close the file.

        Raises:
            AsfmError: not all of it could be written, as on a full disk.
        """
        try:
            self._flush()
        except RuntimeError as error:
            raise AsfmError(f"{self._path}: cannot write the recording: {' '.join(str(error).split())}") from None
        finally:
            self._stream.disconnect()

    def _flush(self) -> None:
        """Wait for Rerun's writer, but not for ever: where a write fails the writer ends and may never answer.

        Asked again, a writer that has ended is known to have; one that is only slow gets its time.
        """
        try:
            self._stream.flush(timeout_sec=FLUSH_S)
        except RuntimeError:
            self._stream.flush(timeout_sec=PATIENT_FLUSH_S)

    def _log_trajectories(self, sequence: Sequence, estimate: Trajectory) -> list[str]:
        """Draw the lines as a whole, the estimate's once more step by step, and how far each is from the truth.

        Returns:
            The names of the lines that could be drawn.
        """
        lines = drawing.anchor_lines(sequence, estimate)
        for name, line in lines.items():
            strip = self._lines_3d([line.world_from_vehicle[:, :3, 3]], drawing.LINES[name], -1.0)
            self._log(f"world/{name}", strip, static=True)
            if "groundtruth" in lines and name != "groundtruth":
                self._name_curves("drift", {name: drawing.LINES[name]})
                self._log_curve(f"drift/{name}", *drawing.measure_drift(line, lines["groundtruth"]))
        xyz_m = estimate.world_from_vehicle[:, :3, 3]
        for index in range(1, len(xyz_m)):
            self._set_frame(index)
            step = self._lines_3d([xyz_m[index - 1 : index + 1]], drawing.LINES["estimate"], -1.8)
            self._log("world/so_far", step)
        return list(lines)

    def _log_sonar(self, sonar: SonarModel, world_from_sonar: FloatArray) -> None:
        """Draw what the sonar sees as a wire frame, the image on the sheet of zero elevation, and move both."""
        rr, (height, width) = self._rr, drawing.SHEET_SHAPE
        outline = self._lines_3d(drawing.outline_frustum(sonar), drawing.FRUSTUM, -0.7)
        origin = rr.Points3D([[0.0, 0.0, 0.0]], colors=drawing.LINES["estimate"], radii=-5.0)
        sheet = rr.Mesh3D.from_fields(
            **drawing.tessellate_sheet(sonar),
            albedo_texture_format=rr.components.ImageFormat(width, height, color_model="RGB", channel_datatype="U8"),
            albedo_factor=(255, 255, 255, SHEET_OPACITY),
        )
        self._log("world/sonar/frustum", outline, static=True)
        self._log("world/sonar/origin", origin, static=True)
        self._log("world/sonar/image", sheet, static=True)
        for index, pose in enumerate(world_from_sonar):
            self._set_frame(index)
            self._log("world/sonar", rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]))

    def _log_map(self, tracks: Tracks, landmarks: Landmarks) -> None:
        """Draw well constrained points by height, the others' arcs, what of them is in view, and tracks on the fan."""
        good = landmarks.well_constrained
        xyz_m, colours, arc_m = landmarks.xyz_m, drawing.colour_heights(landmarks), landmarks.arc_m
        hints = {"labels": drawing.name_points(landmarks, good), "show_labels": False}
        spread = self._lines_3d(drawing.draw_whiskers(landmarks, good), colours[good], -0.8)
        self._log(
            "world/points", self._rr.Points3D(xyz_m[good], colors=colours[good], radii=-2.5, **hints), static=True
        )
        self._log("world/points/sigma", spread, static=True)
        self._log("world/arcs", self._lines_3d(arc_m[~good], drawing.ARC, -0.6), static=True)
        landmark_of_track = np.full(tracks.count, -1)
        landmark_of_track[landmarks.track] = np.arange(len(landmarks))
        steps = drawing.pair_steps(tracks, self._grids["fan"].pixel_at(tracks.range_m, tracks.bearing_rad))
        hues = drawing.choose_hues(tracks.track)
        for frame, now in enumerate(drawing.split_by_frame(tracks, len(self._stamps_s))):
            seen = landmark_of_track[tracks.track[now]]
            points, arcs = (seen[(seen >= 0) & (good[seen] == wanted)] for wanted in (True, False))
            self._set_frame(frame)
            self._log("counts/tracks", self._rr.Scalars(len(now)))
            self._log("fan/tracks", self._rr.LineStrips2D(steps[now], colors=hues[now], radii=-1.0))
            self._log("world/in_view/points", self._rr.Points3D(xyz_m[points], colors=colours[points], radii=-4.5))
            self._log("world/in_view/arcs", self._lines_3d(arc_m[arcs], drawing.ARC_IN_VIEW, -0.8))

    def _name_curves(self, plot: str, colours: dict[str, tuple[int, int, int]]) -> None:
        for name, colour in colours.items():
            self._log(f"{plot}/{name}", self._rr.SeriesLines(names=name, colors=colour, widths=1.5), static=True)

    def _log_curve(self, entity: str, stamps_s: FloatArray, values: FloatArray) -> None:
        """Plot values over the frames of the given stamps."""
        for index, value in zip(np.searchsorted(self._stamps_s, stamps_s), values, strict=True):
            self._set_frame(int(index))
            self._log(entity, self._rr.Scalars(float(value)))

    def _set_frame(self, index: int) -> None:
        """Move to a frame on both timelines; stamps since 1970 become dates."""
        stamp_s = float(self._stamps_s[index])
        self._stream.set_time("frame", sequence=index)
        self._stream.set_time("time", **{"timestamp" if self._stamps_s[0] > 1e8 else "duration": stamp_s})

    def _log(self, entity: str, archetype: Any, static: bool = False) -> None:
        self._stream.log(entity, archetype, static=static, strict=True)

    def _lines_3d(self, strips: Any, colour: Any, radius: float) -> Any:
        return self._rr.LineStrips3D(strips, colors=colour, radii=radius)

    def _encode(self, kind: str, picture: NDArray[Any], **options: float) -> Any:
        data = drawing.encode_picture(kind, picture)
        return self._rr.EncodedImage(contents=data, media_type=f"image/{kind}", **options)

    def _send_blueprint(self, outlook: drawing.Outlook, lines: Iterable[str] = ()) -> None:
        """Arrange the views: images left, the world right, words and curves below it; open at the end."""
        from rerun import blueprint as rrb

        step_s = float(np.median(np.diff(self._stamps_s))) if len(self._stamps_s) > 1 else 1.0
        below = [
            rrb.TextDocumentView(origin="summary", name="Summary"),
            rrb.TimeSeriesView(origin="counts", name="Found in each frame"),
        ]
        if "groundtruth" in lines:
            name, corner = "Distance from ground truth (m)", rrb.Corner2D.LeftTop
            below.append(rrb.TimeSeriesView(origin="drift", name=name, plot_legend=corner))
        right = rrb.Vertical(
            _view_world(outlook, lines, step_s), rrb.Horizontal(*below, column_shares=[4, 3, 3]), row_shares=[2, 1]
        )
        layout = rrb.Horizontal(_view_images(step_s), right, column_shares=[1, 2])
        panels = rrb.BlueprintPanel(state="collapsed"), rrb.SelectionPanel(state="collapsed")
        time = rrb.TimePanel(state="collapsed", timeline="frame", fps=10.0, play_state="following")
        self._stream.send_blueprint(rrb.Blueprint(layout, *panels, time))


def _view_images(step_s: float) -> Any:
    """Show each frame twice: with what was found in it, and with the tracks that came of it."""
    from rerun import blueprint as rrb

    found, tracked = ["$origin/**", "- $origin/tracks"], ["$origin/image", "$origin/tracks"]
    hidden = dict.fromkeys(drawing.HIDDEN, rrb.EntityBehavior(visible=False))
    return rrb.Vertical(
        rrb.Tabs(
            rrb.Spatial2DView(origin="fan", contents=found, name=FOUND, overrides=hidden),
            rrb.Spatial2DView(origin="polar", name="Polar image", overrides=hidden),
        ),
        rrb.Spatial2DView(
            origin="fan",
            contents=tracked,
            name=f"Fan: tracks over {TAIL_FRAMES} frames",
            overrides={"fan/tracks": _show_last(TAIL_FRAMES, step_s)},
        ),
    )


def _view_world(outlook: drawing.Outlook, lines: Iterable[str], step_s: float) -> Any:
    """Show the map and the lines through it, over a grid that gives the scale."""
    from rerun import blueprint as rrb
    from rerun.components import Plane3D

    return rrb.Spatial3DView(
        origin="world",
        name=f"World: {', '.join([*(drawing.LINE_NAMES[line] for line in lines), 'grid of 1 m'])}",
        overrides={"world/so_far": _show_last(None, step_s)},
        line_grid=rrb.LineGrid3D(spacing=1.0, plane=Plane3D.XY.with_distance(outlook.floor_m)),
        eye_controls=rrb.EyeControls3D(position=outlook.eye_m, look_target=outlook.target_m, eye_up=[0.0, 0.0, 1.0]),
    )


def _show_last(frames: int | None, step_s: float) -> Any:
    """Show what was logged during the last frames, or since the beginning (None), on both timelines."""
    from rerun.blueprint import TimeRangeBoundary, VisibleTimeRange, VisibleTimeRanges

    now, beginning = TimeRangeBoundary.cursor_relative(seq=0), TimeRangeBoundary.infinite()
    starts = {"frame": beginning, "time": beginning}
    if frames is not None:
        starts["frame"] = TimeRangeBoundary.cursor_relative(seq=1 - frames)
        starts["time"] = TimeRangeBoundary.cursor_relative(seconds=(0.5 - frames) * step_s)
    return VisibleTimeRanges([VisibleTimeRange(name, start=start, end=now) for name, start in starts.items()])


def open_viewer(path: Path) -> int:
    """Show a recording in the Rerun viewer and wait until it is closed; returns the viewer's exit code.

    Raises:
        AsfmError: there is no recording at the path.
    """
    if not path.is_file():
        raise AsfmError(f"{path}: expected a recording, found no file; make one with asfm run, without --no-rerun")
    # A window of its own even where one is open, which nobody else on the network can write to.
    options = ["--new", "--bind", "127.0.0.1"]
    return subprocess.run([sys.executable, "-m", "rerun", *options, str(path)], check=False).returncode
