"""Every number that the front-end is asked to reach, in one table, for ``benchmark.py``."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from asfm.commands.text import align
from asfm.config import Config
from asfm.datasets import open_sequence, open_truth
from tools.benchmark.frontend_pass import judge_by_arcs, judge_by_truth, run_frontend
from tools.benchmark.kernels import COMPARISONS, time_in_turns

SHAPE = (512, 512)
CFAR_MS = {"cfar": 4.0, "cfar-goca": 12.0, "cfar-soca": 12.0, "cfar-os": 150.0}
DBSCAN_RATIO = 20.0
SSL_MS, SSL_RATIO, SSL_DIFFERENCE = 10.0, 50.0, 1e-6
FRAME_RATIO = 1.5
PRECISION = {1: 0.97, 8: 0.90}
KEPT = 0.6
STD, ABSOLUTE_MEAN = {"range bins": 0.7, "beams": 0.6}, 0.15
ARC_SHARE = {1: 0.95, 8: 0.90}
SEQUENCES = ("simulated_seafloor", "oculus_tank_b")


@dataclass(frozen=True)
class Requirement:
    """One number of the table."""

    what: str
    reached: float | None
    """None where there was nothing to measure."""
    unit: str = ""
    at_most: float | None = None
    at_least: float | None = None
    """Neither of the two: nothing is asked, the number is there to compare with."""

    @property
    def ok(self) -> bool | None:
        """Whether the number is reached; None where nothing is asked."""
        if self.at_most is None and self.at_least is None:
            return None
        if self.reached is None:
            return False
        over = self.at_most is not None and self.reached > self.at_most
        return not over and (self.at_least is None or self.reached >= self.at_least)

    def cells(self) -> tuple[str, str, str, str, str]:
        """Give what, asked, reached, unit, ok."""
        bound, sign = (self.at_least, "≥") if self.at_most is None else (self.at_most, "≤")
        asked = "" if bound is None else f"{sign} {bound:.3g}" if bound < 1000 else f"{sign} {bound:,.0f}"
        if self.at_most is not None and self.at_least is not None:
            asked = f"{self.at_least:.3g} to {self.at_most:.3g}"
        reached = "-" if self.reached is None else f"{self.reached:.3g}"
        if self.reached is not None and np.isfinite(self.reached) and abs(self.reached) >= 1000:
            reached = f"{self.reached:,.0f}"
        return self.what, asked, reached, self.unit, {None: "", True: "yes", False: "NO"}[self.ok]


def tabulate(numbers: Sequence[Requirement]) -> list[str]:
    """Make the lines of the table."""
    return align([("what", "asked", "reached", "", "ok"), *(number.cells() for number in numbers)], numbers=(1, 2))


def list_numbers(
    data: Path | None, names: Sequence[str], config: Config, rounds: int, clock: Callable[[], float]
) -> Iterator[Requirement]:
    """Measure the stages, then the sequences where their folder is given.

    Raises:
        AsfmError: a sequence cannot be read.
    """
    yield from _measure_stages(rounds, clock)
    for name in names if data is not None else ():
        yield from _measure_sequence((data or Path()) / name, config, clock)


def _measure_stages(rounds: int, clock: Callable[[], float]) -> Iterator[Requirement]:
    for name, limit_ms in CFAR_MS.items():
        yield from _time_stage(name, f"CFAR {(name.partition('-')[2] or 'ca').upper()}", limit_ms, rounds, clock)
    yield from _time_stage("clusters", "DBSCAN", None, rounds, clock, DBSCAN_RATIO)
    yield from _time_stage("ssl", "SSL, 1,000 matches", SSL_MS, rounds, clock, SSL_RATIO)
    comparison = COMPARISONS["ssl"](SHAPE, 0)
    (peer,) = comparison.peers.values()
    difference = float(np.abs(comparison.ours() - peer()).max())
    yield Requirement("SSL, largest difference", difference, "", at_most=SSL_DIFFERENCE)


def _time_stage(
    name: str,
    title: str,
    limit_ms: float | None,
    rounds: int,
    clock: Callable[[], float],
    ratio: float | None = None,
) -> Iterator[Requirement]:
    comparison = COMPARISONS[name](SHAPE, 0)
    ((peer, run),) = comparison.peers.items()
    medians = time_in_turns({"asfm": comparison.ours, "peer": run}, rounds, clock)
    yield Requirement(title, 1e3 * medians["asfm"], "ms", at_most=limit_ms)
    yield Requirement(f"{title}, faster than {peer}", medians["peer"] / medians["asfm"], "times", at_least=ratio)


def _measure_sequence(path: Path, config: Config, clock: Callable[[], float]) -> Iterator[Requirement]:
    """Measure one sequence: the time of a frame, and the matches by whatever truth there is."""
    sequence, read_truth = open_sequence(path), open_truth(path)
    passage = run_frontend(sequence, config, clock)
    title = path.name
    yield Requirement(f"{title}, front-end of a frame", 1e3 * passage.frame_s, "ms")
    yield Requirement(f"{title}, A-KAZE alone", 1e3 * passage.akaze_s, "ms")
    ratio = passage.frame_s / passage.akaze_s if passage.akaze_s > 0 else None
    yield Requirement(f"{title}, front-end over A-KAZE", ratio, "times", at_most=FRAME_RATIO)
    for gap in PRECISION if sequence.groundtruth is not None else ():
        where = f"{title}, gap {gap}"
        if read_truth is None:
            share, of_ratio_test = judge_by_arcs(passage, sequence, gap, config)
            yield Requirement(f"{where}, share on the arc after the ratio test", of_ratio_test)
            yield Requirement(f"{where}, share on the arc", share, at_least=ARC_SHARE[gap])
            continue
        judged = judge_by_truth(passage, sequence, read_truth, gap, config)
        yield Requirement(f"{where}, precision after the ratio test", judged.ratio_test_precision)
        yield Requirement(f"{where}, precision", judged.precision, at_least=PRECISION[gap])
        yield Requirement(f"{where}, share of right matches kept", judged.kept, at_least=KEPT)
        for axis, (unit, limit) in enumerate(STD.items()):
            std, mean = judged.spread(axis)
            yield Requirement(f"{where}, position, standard deviation", std, unit, at_most=limit)
            yield Requirement(f"{where}, position, absolute mean", mean, unit, at_most=ABSOLUTE_MEAN)
