"""Fault hypotheses of a recording: conventions of odometry, depth and attitude, axes, order and scale of the images."""

from collections.abc import Sequence as Rows
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from asfm.geometry.poses import invert
from asfm.geometry.sonar import SonarModel
from asfm.navigation.odometry_hypotheses import (
    AS_RECORDED,
    MARINE,
    TURNED,
    PointPairs,
    median_arc_distance_m,
    odometry_hypotheses,
    planar_inliers,
    to_marine_axes,
)
from asfm.types import FloatArray

ImageAxis = Literal["range", "bearing"]
EVERYTHING_MARINE = "with odometry, depth and attitude in NED/FRD (world z down, y to starboard)"
IMAGES_MIRRORED = "with the images mirrored left to right (or the sonar mounted upside down)"
RANGE_REVERSED = "with the far range in row 0 of the images"
ORDER_REVERSED = "with the images in reversed order"
UNITS = {"mm": 1e-3, "cm": 1e-2, "feet": 0.3048}
"""Metres in the units that odometry may be in."""
UNIT_TOLERANCE = 0.2
"""A scale within this share of a unit is named so."""
SCALE_SEARCH = np.exp(np.linspace(-0.7, 0.7, 15))
"""Factors around the ratio of planar motions and odometry that are tried."""
RANGE_SCALE = (0.7, 1.4)
"""A scale in between may be that of a wrong range window as well as that of the odometry."""
MAX_SHIFT_S = 3.2
MAX_SHIFT_FRAMES = 32
SEARCHED = ("odometry-scale", "time-offset")
"""Codes of hypotheses that are values of one quantity."""
SHIFT_TRIALS = 16
"""Time offsets that are tried on either side."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A fault of the recording, and what the recording would be without it."""

    name: str
    """Completes "points lie D m ..."."""
    world_from_vehicle: FloatArray
    """(N, 4, 4) odometry."""
    reading_signs: tuple[int, int, int] = (1, 1, 1)
    """Factors of height, roll and pitch."""
    images: ImageAxis | None = None
    """Axis of the images that is reversed."""
    vehicle_from_sonar: FloatArray | None = None
    """(4, 4) mounting that explains the images as well, with the odometry as recorded."""
    adoptable: bool = True
    """Whether the fault can be undone; otherwise it is only reported."""
    code: str = "odometry-image-conflict"
    """Code of the diagnostic that reports it."""

    @property
    def correctable(self) -> bool:
        """Whether odometry, depth and attitude are at fault and can be corrected."""
        return self.adoptable and self.images is None


def fault_hypotheses(
    world_from_vehicle: FloatArray, vehicle_from_sonar: FloatArray, pairs: Rows[PointPairs], times_s: FloatArray
) -> list[Hypothesis]:
    """Return the hypotheses of faults, the recording as it is first, then commonest first.

    Args:
        world_from_vehicle: (N, 4, 4) odometry.
        vehicle_from_sonar: (4, 4) lever arm.
        pairs: planar-motion inliers of frame pairs, which give the scale.
        times_s: (N,) stamps of the frames.
    """
    of_odometry = odometry_hypotheses(world_from_vehicle, vehicle_from_sonar)
    marine = of_odometry.pop(MARINE)
    found = [Hypothesis(AS_RECORDED, of_odometry.pop(AS_RECORDED))]
    signs = (-1, 1, -1)
    found += [
        Hypothesis(EVERYTHING_MARINE, to_marine_axes(world_from_vehicle), signs, code="marine-axes"),
        Hypothesis(MARINE, marine, code="marine-axes"),
        Hypothesis(IMAGES_MIRRORED, world_from_vehicle, images="bearing", code="bearing-axis-reversed"),
        Hypothesis(RANGE_REVERSED, world_from_vehicle, images="range", code="range-axis-reversed"),
    ]
    for name, poses in of_odometry.items():
        if name.startswith(TURNED):
            mounting = _turned_mounting(invert(world_from_vehicle[0]) @ poses[0], vehicle_from_sonar)
            found.append(Hypothesis(name, poses, vehicle_from_sonar=mounting, code="mounting-rotated"))
        else:
            found.append(Hypothesis(name, poses))
    ratio = _translation_ratio(world_from_vehicle @ vehicle_from_sonar, pairs)
    for factor in ratio * SCALE_SEARCH if ratio else ():
        found.append(_scaled(world_from_vehicle, float(factor)))
    reversed_order = np.asarray(world_from_vehicle[::-1])
    found.append(Hypothesis(ORDER_REVERSED, reversed_order, adoptable=False, code="images-out-of-order"))
    return [*found, *_shifted(world_from_vehicle, times_s)]


def turned_points(pairs: Rows[PointPairs], axis: ImageAxis, sonar: SonarModel) -> list[PointPairs]:
    """Return the points of frame pairs as they are when an axis of the images is reversed.

    Args:
        pairs: matched points of frame pairs.
        axis: the axis that is reversed.
        sonar: gives the range window and the field of view.
    """
    edges = sonar.range_edges_m if axis == "range" else sonar.bearing_edges_rad
    column, total = (0 if axis == "range" else 1), float(edges[0] + edges[-1])

    def turn(points: FloatArray) -> FloatArray:
        turned = points.copy()
        turned[:, column] = total - turned[:, column]
        return turned

    return [replace(p, range_bearing_a=turn(p.range_bearing_a), range_bearing_b=turn(p.range_bearing_b)) for p in pairs]


def hypothesis_distances(
    hypotheses: Rows[Hypothesis],
    raw: Rows[PointPairs],
    inliers: Rows[PointPairs],
    vehicle_from_sonar: FloatArray,
    sonar: SonarModel,
) -> dict[str, float]:
    """Return the median arc distance in metres of the frame pairs under each hypothesis; infinite where untested.

    Of the scales and of the time offsets only the best is kept.

    Args:
        hypotheses: poses and axes.
        raw: matched points, from which inliers are chosen anew where the range axis is reversed.
        inliers: those of a planar motion under the axes as recorded.
        vehicle_from_sonar: (4, 4) lever arm.
        sonar: gives the elevation aperture.
    """
    points: dict[ImageAxis | None, Rows[PointPairs]] = {
        None: inliers,
        "bearing": turned_points(inliers, "bearing", sonar),
    }
    turned = turned_points(raw, "range", sonar)
    points["range"] = planar_inliers(turned, np.random.default_rng(0))
    distance_m = {}
    for hypothesis in hypotheses:
        world_from_sonar = hypothesis.world_from_vehicle @ vehicle_from_sonar
        known = np.asarray(np.isfinite(world_from_sonar).all(axis=(1, 2)))
        pairs = [pair for pair in points[hypothesis.images] if known[pair.frame_a] and known[pair.frame_b]]
        few = 2 * len(pairs) < len(inliers)
        distances_m = [median_arc_distance_m(pair, world_from_sonar, sonar) for pair in pairs]
        distance_m[hypothesis.name] = np.inf if few or not pairs else float(np.median(distances_m))
    for code in SEARCHED:
        names = [item.name for item in hypotheses if item.code == code]
        best = min(names, key=lambda name: distance_m[name], default="")
        distance_m = {name: value for name, value in distance_m.items() if name == best or name not in names}
    return distance_m


def _translation_ratio(world_from_sonar: FloatArray, pairs: Rows[PointPairs]) -> float:
    """Return the median ratio of the planar motions' lengths to those of (N, 4, 4) poses; 0 where there is none."""
    planar_m, recorded_m = np.zeros(len(pairs)), np.zeros(len(pairs))
    for index, pair in enumerate(pairs):
        a_from_b = invert(world_from_sonar[pair.frame_a]) @ world_from_sonar[pair.frame_b]
        planar_m[index], recorded_m[index] = np.linalg.norm(pair.a_from_b[:2, 3]), np.linalg.norm(a_from_b[:3, 3])
    moved = np.flatnonzero(recorded_m)
    if not len(moved):
        return 0.0
    planar_m, recorded_m = planar_m[moved], recorded_m[moved]
    long = np.flatnonzero(planar_m >= float(np.median(planar_m)) / 2)
    return float(np.median(planar_m[long] / recorded_m[long]))


def _turned_mounting(turn: FloatArray, vehicle_from_sonar: FloatArray) -> FloatArray:
    """Return the (4, 4) mounting turned by a rotation of the vehicle's axes; the sonar's place does not change."""
    mounting = turn @ vehicle_from_sonar
    mounting[:3, 3] = vehicle_from_sonar[:3, 3]
    return np.asarray(mounting)


def _scaled(world_from_vehicle: FloatArray, factor: float) -> Hypothesis:
    """Return the hypothesis that the positions must be multiplied by a factor; that of a unit where one is near."""
    unit = next((name for name, metres in UNITS.items() if abs(factor / metres - 1) < UNIT_TOLERANCE), None)
    scale = factor if unit is None else UNITS[unit]
    poses = world_from_vehicle.copy()
    poses[:, :3, 3] = world_from_vehicle[0, :3, 3] + scale * (poses[:, :3, 3] - world_from_vehicle[0, :3, 3])
    name = f"with its positions in {unit}" if unit else f"with its positions multiplied by {factor:.3g}"
    adoptable = unit is not None or not RANGE_SCALE[0] < factor < RANGE_SCALE[1]
    return Hypothesis(name, poses, adoptable=adoptable, code="odometry-scale")


def _shifted(world_from_vehicle: FloatArray, times_s: FloatArray) -> list[Hypothesis]:
    """Return the hypotheses of a time offset, as poses shifted by whole frames, NaN where none is known."""
    interval_s = float(np.median(np.diff(times_s))) if len(times_s) > 1 else MAX_SHIFT_S
    longest = min(int(MAX_SHIFT_S / max(interval_s, 1e-9)), MAX_SHIFT_FRAMES, len(times_s) // 3)
    trials = np.linspace(min(longest, 1), longest, min(longest, SHIFT_TRIALS)).round().astype(int)
    found = []
    for shift in [sign * count for count in np.unique(trials).tolist() for sign in (1, -1)]:
        index = np.arange(len(times_s)) + shift
        inside = (index >= 0) & (index < len(times_s))
        poses = np.full(world_from_vehicle.shape, np.nan)
        poses[inside] = world_from_vehicle[index[inside]]
        name = f"with its stamps {abs(shift) * interval_s:.2g} s too {'late' if shift > 0 else 'early'}"
        found.append(Hypothesis(name, poses, adoptable=False, code="time-offset"))
    return found
