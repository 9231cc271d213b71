"""Diagnostics: what is wrong with a recording or uncertain about a result, each with a stable code."""

from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Severity = Literal["info", "warning", "error"]
FrameRuns = tuple[tuple[int, int], ...]
"""Runs of consecutive frames, (first, last) each, both included."""

CODES = {
    # recordings, found by the readers
    "assumed-aperture": "the recording does not state the elevation aperture; a typical value is used",
    "variable-sound-speed": "the sound speed changes during the recording; all ranges use that of the first frame",
    "variable-range-resolution": "the range resolution changes during the recording; that of the first frame is used",
    "unreliable-stamps": "the recorded time stamps cannot be used; frames are spaced at a nominal rate",
    "incomplete-records": "some records hold no sonar image and are left out",
    "pose-not-of-sonar": "the recorded poses are not those of the sonar and are left out",
    "partial-sensor-coverage": "a sensor does not cover all frames",
    "implausible-field-of-view": "no imaging sonar has such a field of view, beam spacing or aperture; radians?",
    "implausible-range": "no imaging sonar has such a range window, or none pings so often at it; millimetres?",
    "implausible-stamps": "frames or readings are too far apart or too close in time; milliseconds?",
    "implausible-motion": "no vehicle moves as fast or dives as deep as a sensor says; millimetres?",
    "positive-height": "all heights are above the origin of a world whose z points up; a depth must be negated",
    "saturated-images": "a large share of the pixels is at the upper end of the scale",
    "clipped-images": "a few pixels lie outside the scale of the images and are cut to it",
    "scaled-images": "the images exceed 0..1 and are scaled by a value found in the recording",
    "images-out-of-order": "the numbers in the names of the images do not rise with the stamps",
    "unused-file": "a file in the folder of the sequence is not read",
    # simulation
    "multiple-sonars": "the scenario has several imaging sonars; the first is simulated",
    "unsupported-setting": "a setting of the scenario is not simulated",
    "short-path": "the given path ends before the requested number of frames",
    "open-mesh": "the mesh is not closed: it reflects from both sides and has no interior to avoid",
    "empty-frames": "some frames see nothing of the scene",
    # odometry, depth and attitude, found before and during initialisation
    "navigation-outliers": "single depth or attitude readings differ from their neighbours and are rejected",
    "navigation-gap": "no depth or attitude reading is near some frames; they are not constrained",
    "odometry-jump": "a step of the odometry differs from its neighbours and is rejected",
    "odometry-gap": "no odometry is near some frames; the steps there get large sigmas",
    "odometry-frame-offset": "odometry starts at another depth or attitude than navigation; its poses are moved",
    "odometry-image-conflict": "the odometry contradicts the images; its steps get larger sigmas or are corrected",
    "marine-axes": "odometry, perhaps with depth and attitude, seems to be in NED/FRD; it is converted",
    "odometry-scale": "the odometry's translations have another scale than the images show; millimetres, feet?",
    "mounting-rotated": "odometry, or the mounting of the sonar, seems to be turned by a quarter or half turn",
    "range-axis-reversed": "the images seem to have their far range in row 0; they are turned",
    "bearing-axis-reversed": "the images seem to be mirrored left to right, or the sonar mounted upside down",
    "image-jumps": "the images change abruptly at some steps where odometry does not; lost or exchanged frames?",
    "image-order": "images resemble a later one far more than the next one; shuffled, or sorted as text?",
    "sensor-conflict": "odometry and navigation contradict each other in depth, roll or pitch",
    "time-offset": "odometry and navigation agree only with shifted time stamps",
    "duplicate-frames": "frames repeat the image before them; while odometry moves, their matches are left out",
    # the estimate
    "single-frame": "the sequence has one frame: there is nothing to reconstruct",
    "unsupported-steps": "too few landmarks connect consecutive frames; the poses there are held by other sensors",
    "no-motion-seen": "no feature moves in any frame: the poses are held where they begin",
    "unobserved-directions": "no measurement but the steps constrains some directions of the motion",
    "position-uncertainty": "the position is too uncertain to be trusted from some frame on",
    "poor-fit": "the solution fits its observations much worse than short stretches of frames do by themselves",
    "mirror-ambiguity": "the scene and its mirror image explain the measurements equally well",
    "odometry-inconsistent": "the result differs from the odometry by more than its stated noise",
    "depth-inconsistent": "the result differs from the depth readings by more than their stated noise",
    "attitude-inconsistent": "the result differs from the attitude readings by more than their stated noise",
    "images-inconsistent": "the result differs from what the images show by more than the noise of features",
    "navigation-convention": "depth and attitude fit the images better with another sign, or with exchanged axes",
    "calibration-inconsistent": "images and other sensors fit together only with another calibration than stated",
    "estimated-lever-rotation": "the rotation of the sonar's mounting was estimated, as requested",
    "estimated-range-bias": "a constant range bias was estimated, as requested",
    # evaluation
    "not-evaluated": "the result could not be compared with the truth that the sequence has",
}
"""Every code with its meaning. Codes are stable: scripts may rely on them."""

MAX_RUNS = 8
"""Messages name at most this many runs of frames and count the others."""


@dataclass(frozen=True)
class Diagnostic:
    """One finding about a recording or a result.

    Raises:
        ValueError: the code is not in :data:`CODES`: a defect of the caller.
    """

    code: str
    """Key of :data:`CODES`."""
    message: str
    """One sentence with the numbers: what was found, where, and what is done about it."""
    frames: FrameRuns = ()
    """The frames concerned; empty where it concerns all of them or none in particular."""
    severity: Severity = "warning"

    def __post_init__(self) -> None:
        if self.code not in CODES:
            raise ValueError(f"expected a code listed in asfm.diagnostics.CODES, found {self.code!r}")

    def __str__(self) -> str:
        return f"{self.message} [{self.code}]"

    def as_dict(self) -> dict[str, Any]:
        """Return what report.json holds of it."""
        return asdict(self)


def frame_runs(selected: NDArray[np.bool_], min_length: int = 1) -> FrameRuns:
    """Return the runs of true values among (N,), as (first, last) indices, both included.

    Args:
        selected: (N,) one value a frame, or one a step from a frame to the next.
        min_length: runs with fewer values are left out.
    """
    edges = np.diff(np.concatenate([[0], selected.astype(int), [0]]))
    starts, stops = np.flatnonzero(edges == 1).tolist(), np.flatnonzero(edges == -1).tolist()
    return tuple((a, b - 1) for a, b in zip(starts, stops, strict=True) if b - a >= min_length)


def step_runs(selected: NDArray[np.bool_]) -> FrameRuns:
    """Return the runs of true values among the (N - 1,) steps, as the first and last frames that they join."""
    return tuple((first, last + 1) for first, last in frame_runs(selected))


def format_runs(runs: FrameRuns) -> str:
    """Format runs of frames for a message: "3-5, 9"; those beyond :data:`MAX_RUNS` are counted."""
    names = [str(first) if first == last else f"{first}-{last}" for first, last in runs]
    more = len(names) - MAX_RUNS
    return ", ".join(names if more <= 0 else [*names[:MAX_RUNS], f"and {more} more runs"])
