"""Recording file written through a pipe: errors of the disk are noticed, and never stop the writer of Rerun."""

import os
import threading
from pathlib import Path

from asfm.errors import AsfmError

CHUNK_BYTES = 1 << 16
"""Bytes read from the pipe at a time; the buffer of a pipe on Linux."""


class RecordingFile:
    """File that a thread fills from a pipe; Rerun opens the pipe by name.

    Rerun's own writer ends at the first error, and then nobody answers those who wait for it. Here the pipe is read to
    its end whatever happens to the file, and the first error is kept for the caller. On systems without ``/dev/fd``
    Rerun writes the file itself.
    """

    def __init__(self, path: Path) -> None:
        """Create the file, and the pipe with its thread.

        Raises:
            AsfmError: the file cannot be written.
        """
        self._path = path
        self._error: OSError | None = None
        self._thread: threading.Thread | None = None
        try:
            self._file = path.open("wb", buffering=0)
        except OSError as error:
            raise self._explain(error) from None
        source, self._sink = os.pipe()
        self.name = f"/dev/fd/{self._sink}"
        """Where Rerun writes."""
        if not os.path.exists(self.name):  # noqa: PTH110 - a Path would be no shorter
            self._close_descriptors(source, self._sink)
            self.name = os.fspath(path)
            return
        self._thread = threading.Thread(target=self._copy, args=(source,), daemon=True)
        self._thread.start()

    def release_sink(self) -> None:
        """Close the own end of the pipe, once Rerun has opened its end: the thread ends when Rerun closes that."""
        if self._thread is not None:
            os.close(self._sink)

    def require_written(self) -> None:
        """Check that all data so far could be written.

        Raises:
            AsfmError: they could not, for example on a full disk.
        """
        if self._error is not None:
            raise self._explain(self._error) from None

    def close(self, timeout_s: float) -> None:
        """Wait until Rerun has closed the pipe and all is in the file.

        Args:
            timeout_s: longest time to wait.

        Raises:
            AsfmError: not all data could be written, or not in this time.
        """
        if self._thread is not None:
            self._thread.join(timeout_s)
            if self._thread.is_alive():
                raise AsfmError(f"{self._path}: cannot write the recording: not finished after {timeout_s:g} s")
        self.require_written()

    def _copy(self, source: int) -> None:
        """Copy the pipe into the file; after an error read on and throw away, so that Rerun never waits."""
        while data := os.read(source, CHUNK_BYTES):
            if self._error is None:
                self._write(data)
        try:
            self._file.close()
        except OSError as error:  # network disks report a full disk here
            self._error = self._error or error
        os.close(source)

    def _write(self, data: bytes) -> None:
        view = memoryview(data)
        try:
            while view:
                view = view[self._file.write(view) :]
        except OSError as error:
            self._error = error

    def _close_descriptors(self, *descriptors: int) -> None:
        self._file.close()
        for descriptor in descriptors:
            os.close(descriptor)

    def _explain(self, error: OSError) -> AsfmError:
        return AsfmError(f"{self._path}: cannot write the recording: {error.strerror}")
