"""Motions of a reference beside those of an estimate, and the steps of the reference that nothing explains."""

from dataclasses import dataclass

import numpy as np

from asfm.navigation.outlier_filter import MAD_TO_SIGMA, MIN_READINGS, OUTLIER_SIGMAS, running_median
from asfm.types import BoolArray, FloatArray

JUMP_FACTOR = 3.0
"""A jump is faster than its neighbours by at least this factor."""
CONTRADICTION_FACTOR = 2.0
"""Motions contradict each other where one is longer than the other by this factor, and by the noise."""
NOISE_SIGMAS = 5.0
MIN_JUMP = np.array([0.05, np.deg2rad(5)])
"""Smaller jumps, in m and rad, are within the noise of trackers."""

MIN_OBSERVED_TURN = 0.3
"""Change of the direction of travel, as the difference of unit vectors, from which on it tells a turn."""


@dataclass(frozen=True)
class PairedMotions:
    """Motions of the reference and of the estimate, in m and in rad, between the same (R,) stamps."""

    timestamps_s: FloatArray
    reference: FloatArray
    """(R, 4, 4) world_from_vehicle."""
    estimate: FloatArray
    """(R, 4, 4) world_from_vehicle, in any world."""

    def select(self, which: BoolArray) -> "PairedMotions":
        """Return the motions between the chosen (R,) stamps alone."""
        return PairedMotions(self.timestamps_s[which], self.reference[which], self.estimate[which])

    def contradict(self, first: int, last: int, noise: FloatArray) -> bool:
        """Return whether the reference moves farther between two stamps than the estimate and (2,) noise explain."""
        of_reference, of_estimate = (motion_lengths(poses, first, last) for poses in (self.reference, self.estimate))
        return bool(np.any(of_reference > CONTRADICTION_FACTOR * of_estimate + NOISE_SIGMAS * noise + MIN_JUMP))

    def noise(self) -> FloatArray:
        """Return the standard deviations (2,), by MAD, of how far the steps' lengths differ."""
        of_reference, of_estimate = (
            np.linalg.norm(step_vectors(poses), axis=2) for poses in (self.reference, self.estimate)
        )
        return np.asarray(MAD_TO_SIGMA * np.median(np.abs(of_reference - of_estimate), axis=1))


def jumping_steps(motions: PairedMotions) -> BoolArray:
    """Find the steps (R - 1,) of a reference that neither their neighbours nor the estimate explain."""
    elapsed_s = np.diff(motions.timestamps_s)
    jump = np.zeros(len(elapsed_s), dtype=bool)
    if len(elapsed_s) < MIN_READINGS:
        return jump
    for kind, steps in enumerate(step_vectors(motions.reference)):
        speed = steps / elapsed_s[:, None]
        median = running_median(speed)
        deviation = np.linalg.norm(speed - median, axis=1)
        limit = OUTLIER_SIGMAS * MAD_TO_SIGMA * np.median(deviation)
        faster = deviation > np.maximum(limit, JUMP_FACTOR * np.linalg.norm(median, axis=1))
        for step in np.flatnonzero(faster).tolist() if kind == 1 else ():
            faster[step] = not _turns_its_course(motions.reference, step)
        jump |= faster
    noise = motions.noise()
    for step in np.flatnonzero(jump).tolist():
        jump[step] = motions.contradict(step, step + 1, noise)
    return jump


def _turns_its_course(poses: FloatArray, step: int) -> bool:
    """Return whether the path turns with the orientation in a step: the vehicle turned, not only its marker.

    The direction of travel in the vehicle's frame is then the same before and after. Where the turn is about that
    direction, or the vehicle rests, nothing is known: false.
    """
    before_from_after = poses[step, :3, :3].T @ poses[step + 1, :3, :3]
    travel = np.diff(poses[:, :3, 3], axis=0)
    before, after = travel[max(step - 3, 0) : step].sum(axis=0), travel[step + 1 : step + 4].sum(axis=0)
    sizes = np.linalg.norm(before), np.linalg.norm(after)
    if min(sizes) < MIN_JUMP[0]:
        return False
    before, after = poses[step, :3, :3].T @ before / sizes[0], poses[step + 1, :3, :3].T @ after / sizes[1]
    by_marker = np.linalg.norm(before_from_after.T @ before - before)
    return bool(by_marker > MIN_OBSERVED_TURN and np.linalg.norm(after - before) < by_marker / 2)


def step_vectors(poses: FloatArray) -> FloatArray:
    """Return the (2, R - 1, 3) translations in m and rotation vectors in rad from each pose to the next."""
    from scipy.spatial.transform import Rotation  # slow to load

    rotation = Rotation.from_matrix(poses[:, :3, :3])
    turn_rad = (rotation[:-1].inv() * rotation[1:]).as_rotvec()
    return np.stack([np.diff(poses[:, :3, 3], axis=0), turn_rad])


def motion_lengths(poses: FloatArray, first: int, last: int) -> FloatArray:
    """Return the lengths (2,) in m and rad of the motion from one pose to another."""
    return np.asarray(np.linalg.norm(step_vectors(poses[[first, last]])[:, 0], axis=1))
