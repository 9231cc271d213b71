"""Stretch of a solution: the frames whose depth and attitude vary most, with their most observed tracks."""

from dataclasses import replace

import numpy as np

from asfm.backend.estimation.solution import Solution
from asfm.types import BoolArray

STRETCH_FRAMES = 20
"""Frames of a stretch."""
MAX_TRACKS = 90
"""Tracks of a stretch: those with most observations."""
MIN_VIEWS = 4
"""Observations of a track in the stretch, at least."""


def choose_stretch(solution: Solution) -> tuple[int, int]:
    """Return the first and last frame of the stretch whose depth and attitude vary most, in sigmas, when observed."""
    sensors = solution.problem.sensors
    count = len(sensors.z_roll_pitch)
    length = min(STRETCH_FRAMES, count)
    spread = np.zeros(count - length + 1)
    views = np.bincount(solution.tracks.frame[solution.observed], minlength=count)
    for begin in range(len(spread)):
        part = slice(begin, begin + length)
        known = np.isfinite(sensors.z_roll_pitch_sigma[part])
        deviation = np.where(known, sensors.z_roll_pitch[part], np.nan)
        if known.any(axis=0).all():
            sigma = np.nanmedian(np.where(known, sensors.z_roll_pitch_sigma[part], np.nan), axis=0)
            spread[begin] = float((np.nanstd(deviation, axis=0) / sigma).sum()) * np.sqrt(views[part].sum())
    begin = int(np.argmax(spread))
    return begin, begin + length - 1


def select_stretch(solution: Solution, first: int, last: int) -> Solution:
    """Return a solution's frames first to last alone, with the tracks that are observed most there."""
    tracks = solution.tracks
    used = solution.observed & (tracks.frame >= first) & (tracks.frame <= last)
    views = np.bincount(tracks.track, used, minlength=tracks.count)
    ranked = np.argsort(-views, kind="stable")[:MAX_TRACKS]
    kept = ranked[views[ranked] >= MIN_VIEWS]
    used &= np.isin(tracks.track, kept)
    chosen = tracks.select(used)
    chosen = replace(chosen, frame=chosen.frame - first)
    sensors, part, bundle = solution.problem.sensors, slice(first, last + 1), solution.bundle
    sensors = replace(
        sensors,
        steps=sensors.steps[first:last],
        step_sigma=sensors.step_sigma[first:last],
        z_roll_pitch=sensors.z_roll_pitch[part],
        z_roll_pitch_sigma=sensors.z_roll_pitch_sigma[part],
    )
    observed: BoolArray = np.ones(len(chosen), dtype=bool)
    problem = replace(
        solution.problem, tracks=chosen, observed=observed, sigma=solution.problem.sigma[used], sensors=sensors
    )
    bundle = replace(
        bundle, world_from_vehicle=bundle.world_from_vehicle[part], xyz_m=bundle.xyz_m[np.unique(tracks.track[used])]
    )
    return replace(solution, tracks=chosen, observed=observed, problem=problem, bundle=bundle)
