"""Worker of the test that processes make an entry of the cache once."""

import time
from pathlib import Path

from asfm.study.feature_cache import StudyCache


def provide_slowly(folder: Path, name: str) -> None:
    """Provide an entry whose making takes a while and leaves a trace of its own."""

    def make(partial: Path) -> None:
        (folder / "made").mkdir(exist_ok=True)
        (folder / "made" / name).touch()
        time.sleep(0.5)
        (partial / "value").write_text(name)

    path = StudyCache(folder / "cache").provide("kind", "key", make)
    assert (path / "value").read_text()
