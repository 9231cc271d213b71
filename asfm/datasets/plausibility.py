"""Plausibility of a recording's values, whatever its format: what cannot be is refused, what is rare is told."""

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from asfm.datasets.value_bounds import MAX_MEDIAN_STEP_S, check_stamps, median_step_s
from asfm.diagnostics import Diagnostic, frame_runs
from asfm.errors import AsfmError
from asfm.geometry.sonar import SonarModel
from asfm.sequence import Sequence
from asfm.types import FloatArray, Trajectory

SPLASH_SHARE = 0.1
"""Depths count as above the surface where they reach at most this share of the greatest height below it."""
FULL_TURN_RAD = 2 * np.pi * (1 + 1e-6)
MIN_FIELD_OF_VIEW_DEG = 7.0
"""Narrower than any imaging sonar (a telephoto ARIS has 15 degrees), and wider than a full turn's number of radians."""
MIN_BEAM_SPACING_DEG = 0.02
"""The finest imaging sonars have 0.08 degrees a beam."""
MIN_APERTURE_DEG, MAX_APERTURE_DEG = 0.9, 90.0
"""Concentrator lenses narrow a DIDSON's aperture to one degree; no imaging sonar is wider than the upper bound."""
MAX_RANGE_STEP_M = 2.0
"""Imaging sonars resolve centimetres."""
RANGES_M = (0.2, 1500.0)
"""Range windows of imaging sonars end between these."""
SOUND_SPEED_M_S = 1500.0
SPARE_ECHO_TIME = 1.2
"""A ping may take this much longer than frames are apart: the sound speed varies, and stamps jitter."""
FRAME_STEPS_S = (5e-4, 20.0)
"""Median times between frames of imaging sonars lie well between these; of other sensors below the second."""
MAX_SPEED_M_S = 15.0
"""Faster than any vehicle with an imaging sonar surveys."""
MAX_DEPTH_M = 12000.0
"""The ocean is 11 km deep."""
MAX_SATURATED = 0.03
"""Largest usual share of pixels at the upper end of the scale."""
SAMPLED_FRAMES = 3


def check_plausibility(path: Path, sequence: Sequence) -> Sequence:
    """Check the values of a sequence that a reader returned.

    Args:
        path: the recording, for messages.
        sequence: any sequence; up to three of its frames are read.

    Returns:
        The sequence with a diagnostic for each value that is rare, which a wrong unit often explains.

    Raises:
        AsfmError: a value cannot be: stamps beyond every clock, or a field of view of more than a full turn.
    """
    check_stamps(path, sequence.timestamps_s)
    field_of_view_rad = float(np.ptp(sequence.sonar.bearing_edges_rad))
    if field_of_view_rad > FULL_TURN_RAD:
        raise AsfmError(
            f"{path}: expected beams within a full turn, found a field of view of "
            f"{np.degrees(field_of_view_rad):.1f} deg: correct the bearings"
        )
    found = (
        *_check_field_of_view(sequence.sonar),
        *_check_range(sequence),
        *_check_stamp_steps(sequence),
        *_check_motion(sequence),
        *_check_height(sequence),
        *_check_saturation(sequence),
    )
    return dataclasses.replace(sequence, diagnostics=(*sequence.diagnostics, *found)) if found else sequence


def _check_field_of_view(sonar: SonarModel) -> Iterator[Diagnostic]:
    field_deg = float(np.degrees(np.ptp(sonar.bearing_edges_rad)))
    step_deg, aperture_deg = float(np.degrees(sonar.bearing_step_rad)), float(np.degrees(sonar.elevation_aperture_rad))
    if field_deg < MIN_FIELD_OF_VIEW_DEG or step_deg < MIN_BEAM_SPACING_DEG:
        message = (
            f"the bearings give a field of view of {field_deg:.3g} deg, {step_deg:.2g} deg a beam, "
            f"narrower than any imaging sonar's{_radians_hint(field_deg)}"
        )
        yield Diagnostic("implausible-field-of-view", message)
    if not MIN_APERTURE_DEG <= aperture_deg <= MAX_APERTURE_DEG:
        narrow = aperture_deg < MIN_APERTURE_DEG
        message = (
            f"the elevation aperture is {aperture_deg:.3g} deg, "
            f"{'narrower' if narrow else 'wider'} than any imaging sonar's"
            f"{_radians_hint(aperture_deg) if narrow else ': correct it'}"
        )
        yield Diagnostic("implausible-field-of-view", message)


def _radians_hint(found_deg: float) -> str:
    as_radians_deg = np.degrees(found_deg)
    return f": radians? ({found_deg:.3g} rad are {as_radians_deg:.3g} deg)" if as_radians_deg <= 361 else ": correct it"


def _check_range(sequence: Sequence) -> Iterator[Diagnostic]:
    far_m, step_m = float(sequence.sonar.range_edges_m[-1]), sequence.sonar.range_step_m
    what = f"the sonar's range window ends at {far_m:.6g} m, {step_m:.3g} m a row"
    unit = "millimetres, centimetres or feet?"
    frame_step_s = median_step_s(sequence.timestamps_s)
    echo_s = 2 * far_m / SOUND_SPEED_M_S
    if far_m < RANGES_M[0]:
        yield Diagnostic("implausible-range", f"{what}, nearer than any imaging sonar looks: kilometres?")
    elif step_m > MAX_RANGE_STEP_M or far_m > RANGES_M[1]:
        yield Diagnostic("implausible-range", f"{what}, beyond any imaging sonar's: {unit}")
    elif echo_s > SPARE_ECHO_TIME * frame_step_s and not _has_nominal_stamps(sequence):
        yield Diagnostic(
            "implausible-range",
            f"{what}: an echo from there takes {echo_s:.3g} s, but the frames are {frame_step_s:.3g} s apart: "
            f"a range in {unit} or stamps in another unit?",
        )


def _has_nominal_stamps(sequence: Sequence) -> bool:
    return any(item.code == "unreliable-stamps" for item in sequence.diagnostics)


def _check_stamp_steps(sequence: Sequence) -> Iterator[Diagnostic]:
    sensors = {name: trajectory.timestamps_s for name, trajectory in _trajectories(sequence)}
    if sequence.navigation is not None:
        sensors["navigation"] = sequence.navigation.timestamps_s
    for name, stamps_s in (("frames", sequence.timestamps_s), *sensors.items()):
        step_s = median_step_s(stamps_s)
        if FRAME_STEPS_S[1] < step_s <= MAX_MEDIAN_STEP_S:
            message = f"the stamps of {name} are {step_s:.4g} s apart, rarer than any survey's: milliseconds?"
            yield Diagnostic("implausible-stamps", message)
        elif name == "frames" and step_s < FRAME_STEPS_S[0]:
            message = f"the stamps of {name} are {step_s:.3g} s apart, faster than any sonar pings: minutes or days?"
            yield Diagnostic("implausible-stamps", message)


def _check_motion(sequence: Sequence) -> Iterator[Diagnostic]:
    window_m = float(sequence.sonar.range_edges_m[-1])
    for name, trajectory in _trajectories(sequence):
        speed_m_s = _median_speed(trajectory.timestamps_s, trajectory.world_from_vehicle[:, :3, 3])
        step_m = speed_m_s * median_step_s(sequence.timestamps_s)
        if speed_m_s > MAX_SPEED_M_S or step_m > window_m:
            message = (
                f"by {name} the vehicle moves at {speed_m_s:.4g} m/s, {step_m:.3g} m a frame, while the sonar sees "
                f"{window_m:.4g} m far: positions in millimetres, centimetres or degrees, or stamps in another unit?"
            )
            yield Diagnostic("implausible-motion", message)
    if sequence.navigation is not None:
        stamps_s, z_m = sequence.navigation.timestamps_s, sequence.navigation.z_m
        speed_m_s, deepest_m = _median_speed(stamps_s, z_m[:, None]), float(np.abs(z_m).max())
        if speed_m_s > MAX_SPEED_M_S or deepest_m > MAX_DEPTH_M:
            message = (
                f"by navigation z_m reaches {deepest_m:.5g} m and changes by {speed_m_s:.4g} m/s: "
                "millimetres, centimetres or pascals instead of metres?"
            )
            yield Diagnostic("implausible-motion", message)


def _trajectories(sequence: Sequence) -> list[tuple[str, Trajectory]]:
    named = (("odometry", sequence.odometry), ("ground truth", sequence.groundtruth))
    return [(name, trajectory) for name, trajectory in named if trajectory is not None]


def _median_speed(timestamps_s: FloatArray, positions_m: FloatArray) -> float:
    """Return the median speed between (N, D) positions, 0 where there is only one; readings that repeat are skipped."""
    steps_m = np.linalg.norm(np.diff(positions_m, axis=0), axis=1)
    speeds = (steps_m / np.diff(timestamps_s))[steps_m > 0]
    return float(np.median(speeds)) if len(speeds) else 0.0


def _check_height(sequence: Sequence) -> Iterator[Diagnostic]:
    """Say what a positive z_m means where no odometry could contradict it."""
    if sequence.navigation is None or sequence.odometry is not None:
        return
    low_m, high_m = float(sequence.navigation.z_m.min()), float(sequence.navigation.z_m.max())
    if high_m > 0 and low_m > -SPLASH_SHARE * high_m:
        place = "above" if low_m > 0 else "mostly above"
        message = (
            f"z_m runs from {low_m:.2f} to {high_m:.2f} m, {place} the origin of a world whose z points up: "
            "a depth, which grows downwards, must be negated"
        )
        yield Diagnostic("positive-height", message, severity="info")


def _check_saturation(sequence: Sequence) -> Iterator[Diagnostic]:
    """Look at the first, the middle and the last frame; those that cannot be read are reported when they are used."""
    count = len(sequence)
    saturated = np.zeros(count, dtype=bool)
    shares = []
    for index in sorted({round(place * (count - 1) / (SAMPLED_FRAMES - 1)) for place in range(SAMPLED_FRAMES)}):
        try:
            frame = sequence.read_frame(index)
        except AsfmError:
            continue
        valid = frame.image[~frame.invalid]
        shares.append(float((valid >= 1).mean()) if valid.size else 0.0)
        saturated[index] = shares[-1] > MAX_SATURATED
    if saturated.any():
        message = (
            f"{100 * max(shares):.1f} % of the pixels are at the upper end of the scale in {saturated.sum()} of "
            f"{len(shares)} frames looked at: echoes are cut off there; lower the gain or mend the conversion"
        )
        yield Diagnostic("saturated-images", message, frame_runs(saturated))
