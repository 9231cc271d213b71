"""Rerun stream into an .rrd file: timelines of the frames, lines, curves, and flushing with timeouts."""

from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np

from asfm.errors import AsfmError
from asfm.types import FloatArray
from asfm.visualization.colours import Colour

FLUSH_TIMEOUT_S, SECOND_FLUSH_TIMEOUT_S = 5.0, 60.0
"""Time to wait until the recording is written, at the first and at the second attempt."""


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

        try:
            path.open("wb").close()
        except OSError as error:
            raise AsfmError(f"{path}: cannot write the recording: {error.strerror}") from None
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
            self._stream.save(path)
        except RuntimeError as error:
            raise self._write_error(error) from None
        self._stream.send_recording_name(name)

    def set_frame(self, index: int) -> None:
        """Set the time of both timelines to a frame; stamps since 1970 become dates."""
        stamp_s = float(self._stamps_s[index])
        self._stream.set_time("frame", sequence=index)
        self._stream.set_time("time", **{"timestamp" if self._stamps_s[0] > 1e8 else "duration": stamp_s})

    def log(self, entity: str, archetype: Any, static: bool = False) -> None:
        """Log a Rerun archetype at the current frame, or for all times (static)."""
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
        except RuntimeError as error:
            raise self._write_error(error) from None
        finally:
            self._stream.disconnect()

    def _flush(self) -> None:
        """Wait for Rerun's writer thread, with a timeout: after a failed write it ends and may never answer.

        At the second call Rerun knows that a thread has ended; a thread that is only slow gets more time.
        """
        try:
            self._stream.flush(timeout_sec=FLUSH_TIMEOUT_S)
        except RuntimeError:
            self._stream.flush(timeout_sec=SECOND_FLUSH_TIMEOUT_S)

    def _write_error(self, error: RuntimeError) -> AsfmError:
        return AsfmError(f"{self._path}: cannot write the recording: {' '.join(str(error).split())}")
