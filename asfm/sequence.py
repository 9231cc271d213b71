"""Sequence of sonar frames with navigation and calibration: what every reader returns."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from asfm.diagnostics import Diagnostic
from asfm.geometry.sonar import SonarModel
from asfm.types import FloatArray, Frame, HandTracks, Navigation, SensorNoise, Trajectory


@dataclass(frozen=True)
class Sequence:
    """Frames of one sonar in time order. Images are read one at a time, by :attr:`read_frame`."""

    name: str
    sonar: SonarModel
    timestamps_s: FloatArray
    """(N,) strictly rising."""
    read_frame: Callable[[int], Frame]
    """Reads frame i (0..N-1); raises AsfmError naming the file where it cannot."""
    vehicle_from_sonar: FloatArray = field(default_factory=lambda: np.eye(4))
    """(4, 4) mounting of the sonar on the vehicle (lever arm)."""
    odometry: Trajectory | None = None
    """Dead-reckoned world_from_vehicle, drifting."""
    navigation: Navigation | None = None
    groundtruth: Trajectory | None = None
    """True world_from_vehicle."""
    noise: SensorNoise = field(default_factory=SensorNoise)
    hand_tracks: HandTracks | None = None
    kind: str = "native"
    """Name of the file format."""
    diagnostics: tuple[Diagnostic, ...] = ()
    """Problems that the reader found and worked around."""
    check_frames: Callable[[], None] = lambda: None
    """Looks at the headers of all images, cheaply; raises AsfmError naming the first that cannot be read."""

    def __len__(self) -> int:
        return len(self.timestamps_s)

    def __iter__(self) -> Iterator[Frame]:
        return (self.read_frame(index) for index in range(len(self)))
