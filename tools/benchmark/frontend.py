"""Requirements on the front-end: times of its stages, and match quality on sequences with true poses."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from asfm.config import Config
from asfm.datasets import open_sequence, open_truth
from asfm.evaluation.matching import MatchQuality, evaluate_by_arcs, evaluate_by_truth, pool_pairs
from asfm.evaluation.trajectory import interpolate_groundtruth
from asfm.sequence import Sequence as SonarSequence
from asfm.types import FloatArray, FrameTruth
from tools.benchmark.frontend_pass import FrontendPass, match_by_descriptors, run_frontend
from tools.benchmark.kernels import COMPARISONS, time_in_turns
from tools.benchmark.table import Requirement

SHAPE = (512, 512)
"""Ranges and beams of the images that the stages are timed on."""
MAX_CFAR_MS = {"cfar": 4.0, "cfar-goca": 12.0, "cfar-soca": 12.0, "cfar-os": 150.0}
MIN_DBSCAN_SPEEDUP = 20.0
MAX_SSL_MS, MIN_SSL_SPEEDUP, MAX_SSL_DIFFERENCE = 10.0, 50.0, 1e-6
MAX_FRAME_OVER_AKAZE = 1.5
MIN_PRECISION = {1: 0.97, 8: 0.90}
"""By frame gap."""
MIN_KEPT_SHARE = 0.6
MIN_ARC_INLIER_RATIO = {1: 0.95, 8: 0.90}
"""By frame gap."""
NO_PAIRS = pool_pairs([])
SEQUENCES = ("simulated_seafloor", "oculus_tank_b")


def list_frontend_numbers(
    data: Path | None, names: Sequence[str], config: Config, rounds: int, clock: Callable[[], float]
) -> Iterator[Requirement]:
    """Measure the stages, then the sequences if a data folder is given.

    Raises:
        AsfmError: a sequence cannot be read.
    """
    yield from _measure_stages(rounds, clock)
    for name in names if data is not None else ():
        yield from _measure_sequence((data or Path()) / name, config, clock)


def _measure_stages(rounds: int, clock: Callable[[], float]) -> Iterator[Requirement]:
    for name, max_ms in MAX_CFAR_MS.items():
        yield from _time_stage(name, f"CFAR {(name.partition('-')[2] or 'ca').upper()}", rounds, clock, max_ms)
    yield from _time_stage("clusters", "DBSCAN", rounds, clock, min_speedup=MIN_DBSCAN_SPEEDUP)
    yield from _time_stage("ssl", "SSL, 1,000 matches", rounds, clock, MAX_SSL_MS, MIN_SSL_SPEEDUP)
    comparison = COMPARISONS["ssl"](SHAPE, 0)
    (peer,) = comparison.peers.values()
    difference = float(np.abs(comparison.ours() - peer()).max())
    yield Requirement("SSL, largest difference", difference, "", at_most=MAX_SSL_DIFFERENCE)


def _time_stage(
    name: str,
    title: str,
    rounds: int,
    clock: Callable[[], float],
    max_ms: float | None = None,
    min_speedup: float | None = None,
) -> Iterator[Requirement]:
    """Time a stage and its peer."""
    comparison = COMPARISONS[name](SHAPE, 0)
    ((peer, run),) = comparison.peers.items()
    medians = time_in_turns({"asfm": comparison.ours, "peer": run}, rounds, clock)
    yield Requirement(title, 1e3 * medians["asfm"], "ms", at_most=max_ms)
    yield Requirement(f"{title}, faster than {peer}", medians["peer"] / medians["asfm"], "times", at_least=min_speedup)


def _measure_sequence(path: Path, config: Config, clock: Callable[[], float]) -> Iterator[Requirement]:
    """Measure the time of a frame, and the matches against the truth that the sequence has."""
    sequence, read_truth, title = open_sequence(path), open_truth(path), path.name
    frontend = run_frontend(sequence, config, clock)
    yield Requirement(f"{title}, front-end of a frame", 1e3 * frontend.frame_s, "ms")
    yield Requirement(f"{title}, A-KAZE alone", 1e3 * frontend.akaze_s, "ms")
    ratio = frontend.frame_s / frontend.akaze_s if frontend.akaze_s > 0 else None
    yield Requirement(f"{title}, front-end over A-KAZE", ratio, "times", at_most=MAX_FRAME_OVER_AKAZE)
    if sequence.groundtruth is None:
        return
    world_from_sonar = interpolate_groundtruth(sequence) @ sequence.vehicle_from_sonar
    if read_truth is None:
        yield from _list_arc_inliers(title, frontend, sequence, world_from_sonar, config)
    else:
        yield from _list_precision(title, frontend, sequence, world_from_sonar, read_truth, config)


def _list_arc_inliers(
    title: str, frontend: FrontendPass, sequence: SonarSequence, world_from_sonar: FloatArray, config: Config
) -> Iterator[Requirement]:
    filtered = [pair for gap in MIN_ARC_INLIER_RATIO for pair in frontend.pairs(gap)]
    unfiltered = match_by_descriptors(frontend.keypoints, filtered, config.matching)
    after, before = (
        evaluate_by_arcs(frontend.keypoints, pairs, world_from_sonar, sequence.sonar)
        for pairs in (filtered, unfiltered)
    )
    for gap, required in MIN_ARC_INLIER_RATIO.items():
        where = f"{title}, gap {gap}"
        ratio_before, ratio = (
            float(inlier[gap].mean()) if gap in inlier and len(inlier[gap]) else None for inlier in (before, after)
        )
        yield Requirement(f"{where}, arc inlier ratio after the ratio test", ratio_before)
        yield Requirement(f"{where}, arc inlier ratio", ratio, at_least=required)


def _list_precision(
    title: str,
    frontend: FrontendPass,
    sequence: SonarSequence,
    world_from_sonar: FloatArray,
    read_truth: Callable[[int], FrameTruth],
    config: Config,
) -> Iterator[Requirement]:
    filtered = [pair for gap in MIN_PRECISION for pair in frontend.pairs(gap)]
    unfiltered = match_by_descriptors(frontend.keypoints, filtered, config.matching)
    after, before = (
        evaluate_by_truth(frontend.keypoints, pairs, world_from_sonar, read_truth) for pairs in (filtered, unfiltered)
    )
    for gap, required in MIN_PRECISION.items():
        where, quality, ratio_test = f"{title}, gap {gap}", after.get(gap, NO_PAIRS), before.get(gap, NO_PAIRS)
        kept = quality.correct / ratio_test.correct if ratio_test.correct else None
        yield Requirement(f"{where}, precision after the ratio test", ratio_test.precision)
        yield Requirement(f"{where}, precision", quality.precision, at_least=required)
        yield Requirement(f"{where}, recall", quality.recall)
        yield Requirement(f"{where}, share of correct matches kept", kept, at_least=MIN_KEPT_SHARE)
        yield from _list_localisation(where, quality, sequence)


def _list_localisation(where: str, quality: MatchQuality, sequence: SonarSequence) -> Iterator[Requirement]:
    """List the localisation error of the detector: both keypoints of a correct match together."""
    sonar = sequence.sonar
    errors = {
        "range bins": quality.range_error_m / sonar.range_step_m,
        "beams": quality.bearing_error_rad / sonar.bearing_step_rad,
    }
    for unit, error in errors.items():
        deviation, mean = (float(error.std()), float(abs(error.mean()))) if len(error) else (None, None)
        yield Requirement(f"{where}, localisation error, standard deviation", deviation, unit)
        yield Requirement(f"{where}, localisation error, absolute mean", mean, unit)
