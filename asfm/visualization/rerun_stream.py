"""Rerun stream into an .rrd file: timelines of the frames, lines, curves, and flushing with timeouts."""

from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np

from asfm.errors import AsfmError
from asfm.types import FloatArray
from asfm.visualization.colours import Colour
from asfm.visualization.recording_file import RecordingFile

CLOSE_TIMEOUT_S = 60.0
"""Time to wait until the recording is written: more than any disk needs that still works."""
FLUSH_TIMEOUT_S = 1.0
"""Time between two looks whether writing has failed."""


class RerunStream:
    """Recording in a file, with the timelines "frame" and "time". Rerun is imported when it is opened.

    Negative radii are sizes in points on the screen, at any distance.
    """

    def __init__(self, path: Path, name: str, recording_id: str, timestamps_s: FloatArray) -> None:
        """Open the file.

        Args:
            path: the .rrd file to write.
            name: of the recording.
            recording_id: the viewer merges recordings of one id.
            timestamps_s: (N,) stamps of the frames.

        Raises:
            AsfmError: the file cannot be written.
        """
        import rerun

        self._file = RecordingFile(path)
        self.rerun: Any = rerun
        self._path, self._stamps_s = path, timestamps_s
        self._stream = rerun.RecordingStream(
            "asfm",
            recording_id=recording_id,
            send_properties=False,
            # Neither chunk boundaries nor contents may depend on the clock: the same run gives the same recording.
            batcher_config=rerun.ChunkBatcherConfig(flush_tick=timedelta(days=1)),
        )
        self._stream.set_log_time_enabled(False)
        self._stream.set_log_tick_enabled(False)
        try:
            self._stream.save(self._file.name)
        except RuntimeError as error:
            raise self._write_error(error) from None
        finally:
            self._file.release_sink()
        self._stream.send_recording_name(name)

    def set_frame(self, index: int) -> None:
        """Set the time of both timelines to a frame; stamps since 1970 become dates."""
        stamp_s = float(self._stamps_s[index])
        self._stream.set_time("frame", sequence=index)
        self._stream.set_time("time", **{"timestamp" if self._stamps_s[0] > 1e8 else "duration": stamp_s})

    def log(self, entity: str, archetype: Any, static: bool = False) -> None:
        """Log a Rerun archetype at the current frame, or for all times (static).

        Raises:
            AsfmError: earlier data could not be written, for example on a full disk.
        """
        self._file.require_written()
        self._stream.log(entity, archetype, static=static, strict=True)

    def log_lines(self, entity: str, strips: Any, colour: Any, radius: float, static: bool = False) -> None:
        """Log line strips of (P, 3) points, in one colour or one per strip."""
        self.log(entity, self.rerun.LineStrips3D(strips, colors=colour, radii=radius), static)

    def name_curves(self, plot: str, curves: dict[str, Colour]) -> None:
        """Log the names and colours of the curves of a plot."""
        for name, colour in curves.items():
            self.log(f"{plot}/{name}", self.rerun.SeriesLines(names=name, colors=colour, widths=1.5), static=True)

    def log_curve(self, entity: str, timestamps_s: FloatArray, values: FloatArray) -> None:
        """Log (M,) values at the frames with (M,) stamps."""
        for index, value in zip(np.searchsorted(self._stamps_s, timestamps_s), values, strict=True):
            self.set_frame(int(index))
            self.log(entity, self.rerun.Scalars(float(value)))

    def send_blueprint(self, blueprint: Any) -> None:
        """Set the layout of the viewer."""
        self._stream.send_blueprint(blueprint)

    def close(self) -> None:
        """Write all buffered data and close the file.

        Raises:
            AsfmError: not all data could be written, for example on a full disk.
        """
        try:
            self._flush()
        finally:
            self._stream.disconnect()
        self._file.close(CLOSE_TIMEOUT_S)

    def _flush(self) -> None:
        """Wait until Rerun has passed on all data, as long as writing does not fail."""
        for attempt in range(round(CLOSE_TIMEOUT_S / FLUSH_TIMEOUT_S), 0, -1):
            try:
                self._stream.flush(timeout_sec=FLUSH_TIMEOUT_S)
                break
            except RuntimeError as error:
                self._file.require_written()
                if attempt == 1:
                    raise self._write_error(error) from None

    def _write_error(self, error: RuntimeError) -> AsfmError:
        return AsfmError(f"{self._path}: cannot write the recording: {' '.join(str(error).split())}")
