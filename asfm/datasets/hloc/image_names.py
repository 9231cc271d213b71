"""Names of a sequence's images in other programs' files, and the direction of their columns."""

from dataclasses import dataclass, replace
from pathlib import Path

from asfm.datasets.native.reader import is_native, locate_native_frames
from asfm.sequence import Sequence
from asfm.types import IntArray


@dataclass(frozen=True)
class ImageNames:
    """Names, size and column order of the images on disk."""

    names: tuple[str, ...]
    """One per frame: the path in frames.csv, or the frame number in six digits where frames are not image files,
    or where two of them name the same file."""
    shape: tuple[int, int]
    """(ranges, beams)"""
    descending: bool = False
    """Whether column 0 on disk is the port-most beam, whereas asfm's is the starboard-most."""

    def take(self, chosen: IntArray) -> "ImageNames":
        """Return the names of the (M,) chosen frames."""
        return replace(self, names=tuple(self.names[frame] for frame in chosen.tolist()))

    def find_frames(self) -> dict[str, int]:
        """Return the frame of every accepted name: with or without folder, with or without suffix."""
        found: dict[str, int] = {}
        for frame, name in enumerate(self.names):
            path = Path(name)
            for variant in (name, path.name, path.with_suffix("").as_posix(), path.stem):
                found.setdefault(variant, frame)
        return found


def name_images(path: Path, sequence: Sequence) -> ImageNames:
    """Return the image names of a sequence.

    Args:
        path: where the sequence was opened.
        sequence: the sequence.

    Raises:
        AsfmError: frames.csv or sequence.yaml of a native folder cannot be read.
    """
    if not is_native(path):
        return ImageNames(tuple(f"{frame:06d}" for frame in range(len(sequence))), sequence.sonar.shape)
    frames = locate_native_frames(path)
    names = tuple(image.relative_to(path).as_posix() for image in frames.images)
    if len(set(names)) < len(names):
        names = tuple(f"{frame:06d}" for frame in range(len(names)))
    return ImageNames(names, frames.shape, frames.descending)
