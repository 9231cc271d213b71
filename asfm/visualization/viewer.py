"""The Rerun viewer as a separate process."""

import subprocess
import sys
from pathlib import Path

from asfm.errors import AsfmError


def open_viewer(path: Path) -> int:
    """Show a recording in the Rerun viewer and wait until it is closed.

    Returns:
        The exit code of the viewer.

    Raises:
        AsfmError: there is no recording at the path.
    """
    if not path.is_file():
        raise AsfmError(f"{path}: expected a recording, found no file; make one with asfm run, without --no-rerun")
    # A new window even where one is open; nobody else on the network can write to it.
    options = ["--new", "--bind", "127.0.0.1"]
    return subprocess.run([sys.executable, "-m", "rerun", *options, str(path)], check=False).returncode
