"""Files beside a mesh that it refers to, such as the buffers of glTF: read from its own folder only."""

from pathlib import Path
from typing import Any

from asfm.regular_file import check_inside, read_file


class FolderResolver:
    """Reader of the files that a mesh names, as trimesh asks for them."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def get(self, name: str) -> bytes:
        """Return the content of a file in the folder.

        Raises:
            AsfmError: it is not in the folder, or no regular file.
        """
        path = self._folder / name.strip()
        check_inside(self._folder, path, "a part of the mesh")
        return read_file(path, "a part of the mesh")

    def __getitem__(self, name: str) -> bytes:
        return self.get(name)

    def keys(self) -> list[str]:
        """Return no names: parts are found by name, never by looking around."""
        return []

    def namespaced(self, _namespace: str) -> Any:
        """Return the same resolver: there is one folder only."""
        return self
