"""Plausible mistakes: what people get wrong about sonar, odometry, depth, attitude, clocks and images."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from asfm.geometry.poses import invert
from asfm.sequence import Sequence
from tools.benchmark.sequence_changes import (
    change_images,
    change_odometry,
    change_sonar,
    close_gap,
    convert_all_to_marine,
    convert_to_marine,
    delay_all_sensors,
    delay_by_one,
    delay_navigation,
    read_w_first,
    scale_navigation,
    scale_positions,
    shuffle,
    sort_as_text,
    turn_mounting,
)

Change = Callable[[Sequence], Sequence]
FEET = 1 / 0.3048


@dataclass(frozen=True)
class Mistake:
    """One mistake, and the sensors that are right in spite of it."""

    name: str
    wrong: str
    """images, odometry, navigation, or several: the others alone would give the right result."""
    apply: Change
    about_geometry: bool = False
    """Whether it is about the sonar's own geometry, which the sonar alone cannot check."""


def _geometry(name: str, change: Change) -> Mistake:
    return Mistake(name, "images", change, about_geometry=True)


def _order(name: str, change: Change) -> Mistake:
    return Mistake(name, "images", change)


def _list_geometry() -> list[Mistake]:
    """List wrong statements about the sonar and its mounting: odometry, depth and attitude are right."""
    level, no_lever_m = (0.0, 0.0, 0.0), np.zeros(3)
    turns = {
        "yaw +5": (5.0, 0.0, 0.0),
        "pitch +5": (0.0, 5.0, 0.0),
        "pitch -5": (0.0, -5.0, 0.0),
        "yaw +90": (90.0, 0.0, 0.0),
    }
    return [
        *(
            _geometry(f"range window {k:+.0f} %", partial(change_sonar, range_scale=1 + k / 100))
            for k in (-20, -10, 5, 10, 20)
        ),
        *(_geometry(f"near range {near_m:+g} m", partial(change_sonar, near_m=near_m)) for near_m in (-0.3, 0.5)),
        *(
            _geometry(f"field of view {k:+.0f} %", partial(change_sonar, bearing_scale=1 + k / 100))
            for k in (-46, -20, 10, 20)
        ),
        *(
            _geometry(f"mounting {name} deg", partial(turn_mounting, yaw_pitch_roll_deg=angles, lever_m=no_lever_m))
            for name, angles in turns.items()
        ),
        _geometry(
            "lever arm 0.5 m off", partial(turn_mounting, yaw_pitch_roll_deg=level, lever_m=np.array([0.5, 0.0, 0.0]))
        ),
    ]


def _list_images() -> list[Mistake]:
    """List images turned or in the wrong order."""
    return [
        _geometry("images mirrored", partial(change_images, turn=lambda image: image[:, ::-1])),
        _geometry("far range in row 0", partial(change_images, turn=lambda image: image[::-1])),
        _order("images one frame late", partial(change_images, order=delay_by_one)),
        _order("frames shuffled", partial(change_images, order=shuffle)),
        _order("frames reversed", partial(change_images, order=lambda count: np.arange(count)[::-1])),
        _order("frames sorted as text", partial(change_images, order=sort_as_text)),
        _order("every frame the same", partial(change_images, order=lambda count: np.zeros(count, dtype=np.int64))),
        _order("a second lost, stamps closed up", close_gap),
    ]


def _list_odometry() -> list[Mistake]:
    """List wrong odometry: images, depth and attitude are right."""
    scales = {"x 0.5": 0.5, "x 1.3": 1.3, "in feet": FEET, "in mm": 1000.0}
    return [
        *(
            Mistake(
                f"odometry {name}", "odometry", partial(change_odometry, change=partial(scale_positions, factor=factor))
            )
            for name, factor in scales.items()
        ),
        Mistake("odometry inverted", "odometry", partial(change_odometry, change=invert)),
        Mistake("odometry quaternions w first", "odometry", partial(change_odometry, change=read_w_first)),
        Mistake("odometry in NED/FRD", "odometry", partial(change_odometry, change=convert_to_marine)),
        *(
            Mistake(
                f"odometry {late_s:g} s late", "odometry", partial(change_odometry, change=np.asarray, late_s=late_s)
            )
            for late_s in (0.5, 2.0)
        ),
    ]


def _list_navigation() -> list[Mistake]:
    """List wrong depth and attitude: images and odometry are right."""
    factors = {
        "depth positive down": (-1.0, 1.0, 1.0),
        "pitch negated": (1.0, 1.0, -1.0),
        "roll negated": (1.0, -1.0, 1.0),
        "depth and attitude in NED/FRD": (-1.0, 1.0, -1.0),
        "depth in feet": (FEET, 1.0, 1.0),
    }
    return [
        *(Mistake(name, "navigation", partial(scale_navigation, factors=values)) for name, values in factors.items()),
        Mistake(
            "roll and pitch swapped", "navigation", partial(scale_navigation, factors=(1.0, 1.0, 1.0), swapped=True)
        ),
        Mistake("depth and attitude 0.5 s late", "navigation", partial(delay_navigation, late_s=0.5)),
    ]


MISTAKES = (
    *_list_geometry(),
    *_list_images(),
    *_list_odometry(),
    *_list_navigation(),
    Mistake("everything in NED/FRD", "odometry and navigation", convert_all_to_marine),
    _geometry("odometry, depth and attitude 0.5 s late", delay_all_sensors),
)
"""All of them, by the sensor that is wrong."""
