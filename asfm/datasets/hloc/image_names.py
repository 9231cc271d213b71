"""What the images of a sequence are called by other programs, and which way their columns run."""

from dataclasses import dataclass
from pathlib import Path

from asfm.datasets.native.reader import is_native, locate_native_frames
from asfm.sequence import Sequence


@dataclass(frozen=True)
class ImageNames:
    """The images of a sequence as they lie on disk."""

    names: tuple[str, ...]
    """One a frame: the path in frames.csv, or the frame's number in six digits where images are not files."""
    shape: tuple[int, int]
    """(ranges, beams)"""
    descending: bool = False
    """Column 0 on disk is the most port beam; asfm's is the most starboard one."""

    def find_frames(self) -> dict[str, int]:
        """Give the frame of every name that goes: with or without its folder, with or without its suffix."""
        found: dict[str, int] = {}
        for frame, name in enumerate(self.names):
            path = Path(name)
            for form in (name, path.name, path.with_suffix("").as_posix(), path.stem):
                found.setdefault(form, frame)
        return found


def name_images(path: Path, sequence: Sequence) -> ImageNames:
    """Name the images of the sequence that was opened at a path.

    Raises:
        AsfmError: frames.csv or sequence.yaml of a native folder cannot be read.
    """
    if not is_native(path):
        return ImageNames(tuple(f"{frame:06d}" for frame in range(len(sequence))), sequence.sonar.shape)
    frames = locate_native_frames(path)
    names = tuple(image.relative_to(path).as_posix() for image in frames.images)
    return ImageNames(names, frames.shape, frames.descending)
