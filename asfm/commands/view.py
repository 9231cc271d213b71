"""Command ``asfm view``: open a recording in the Rerun viewer."""

from pathlib import Path

from asfm.errors import AsfmError
from asfm.results.results_folder import RECORDING


def view_folder(folder: Path) -> None:
    """Show the recording of a results folder, or a recording file, and wait until the viewer is closed.

    Raises:
        AsfmError: there is no recording, or the viewer cannot be started.
    """
    from asfm.visualization.viewer import open_viewer

    path = folder / RECORDING if folder.is_dir() else folder
    code = open_viewer(path)
    if code != 0:
        raise AsfmError(f"{path}: the Rerun viewer ended with code {code}: it needs a screen and a graphics driver")
