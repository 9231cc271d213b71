"""The Rerun viewer as a separate process."""

import subprocess
import sys
from pathlib import Path

from asfm.errors import AsfmError
from asfm.file_kinds import SNIFFED_BYTES, name_kind
from asfm.regular_file import is_present, open_file

RECORDING_SIGNATURES = (b"RRF2", b"RRF1", b"RRF0", b"RRIO")
"""First bytes of .rrd files."""


def open_viewer(path: Path) -> int:
    """Show a recording in the Rerun viewer and wait until it is closed.

    Returns:
        The exit code of the viewer.

    Raises:
        AsfmError: there is no recording at the path.
    """
    if not is_present(path):
        raise AsfmError(f"{path}: expected a recording, found no file; make one with asfm run, without --no-rerun")
    with open_file(path, "a recording") as file:
        head = file.read(SNIFFED_BYTES)
    if not head.startswith(RECORDING_SIGNATURES):
        found = name_kind(head) or "another file"
        raise AsfmError(f"{path}: expected a recording of the Rerun viewer, found {found}; make one with asfm run")
    # A new window even where one is open; nobody else on the network can write to it.
    options = ["--new", "--bind", "127.0.0.1"]
    return subprocess.run([sys.executable, "-m", "rerun", *options, str(path)], check=False).returncode
