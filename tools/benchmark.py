"""Measure stages against independent implementations of the same, and whole runs against the truth.

``python tools/benchmark.py all``, or the name of one comparison, times stages side by side in one process. Contenders
take turns, so that a busy machine slows all of them alike; what counts is the ratio of the medians, and whether the
results agree.
``python tools/benchmark.py run SEQUENCE [--set SECTION.KEY=VALUE]...`` measures one ``asfm run`` in a child process.
``python tools/benchmark.py reach DATA_FOLDER`` measures the public recordings one after the other, in one table.
"""

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from benchmark_runs import RunFailed, describe_run, measure_run, tabulate_reach
from numpy.typing import NDArray

from asfm.config import CfarConfig, ClustersConfig, SslConfig
from asfm.types import BoolArray, ImageArray

Array = NDArray[Any]


@dataclass(frozen=True)
class Comparison:
    """One stage with its peers, all of them computing the same."""

    title: str
    ours: Callable[[], Array]
    peers: dict[str, Callable[[], Array]]
    tolerance: float
    """Largest part of the values that may differ: thresholds fall on either side of a rounding error."""


def make_speckle(shape: tuple[int, int], seed: int) -> ImageArray:
    """Make Rayleigh noise, stronger at close range, with a hundred bright squares: (ranges, beams) in 0..1."""
    rng = np.random.default_rng(seed)
    strength = np.linspace(2.0, 1.0, shape[0])[:, None] * np.ones(shape)
    for row, column in zip(rng.integers(0, shape[0], 100), rng.integers(0, shape[1], 100), strict=True):
        strength[row : row + 6, column : column + 6] *= 6
    image = rng.rayleigh(size=shape) * strength
    return np.asarray(image / image.max(), dtype=np.float32)


def compare_cfar(shape: tuple[int, int], seed: int) -> Comparison:
    """Cell averaging CFAR against the same written with SciPy's uniform filter."""
    from scipy.ndimage import uniform_filter

    from asfm.frontend.cfar import detect_cfar

    image, valid, config = make_speckle(shape, seed), np.ones(shape, dtype=bool), CfarConfig()

    def sum_box(values: Array, half_px: tuple[int, int]) -> Array:
        size = (2 * half_px[0] + 1, 2 * half_px[1] + 1)
        return np.asarray(uniform_filter(values, size, mode="constant") * (size[0] * size[1]))

    def with_scipy() -> Array:
        power, ones = image.astype(float) ** 2, np.ones(shape)
        total = sum_box(power, config.reference_px) - sum_box(power, config.guard_px)
        count = np.rint(sum_box(ones, config.reference_px) - sum_box(ones, config.guard_px))
        factor = count * (config.false_alarm_probability ** (-1 / count) - 1)
        return np.asarray(power > factor * total / count)

    ours = partial(detect_cfar, image, valid, config)
    return Comparison(f"cell averaging CFAR, {shape[0]} x {shape[1]}", ours, {"scipy uniform_filter": with_scipy}, 1e-4)


def compare_clusters(shape: tuple[int, int], seed: int) -> Comparison:
    """DBSCAN on the grid against scikit-learn's on the detections' coordinates."""
    from sklearn.cluster import DBSCAN

    from asfm.frontend.clusters import keep_clusters

    detections = _detect(make_speckle(shape, seed))
    config = ClustersConfig()

    def with_sklearn() -> Array:
        where = np.argwhere(detections)
        labels = DBSCAN(eps=config.radius_px, min_samples=config.min_pixels).fit_predict(where)
        kept = np.zeros(shape, dtype=bool)
        kept[tuple(where[labels >= 0].T)] = True
        return kept

    title = f"DBSCAN of {detections.sum()} detections, {shape[0]} x {shape[1]}"
    return Comparison(title, partial(keep_clusters, detections, config), {"scikit-learn DBSCAN": with_sklearn}, 0.0)


def compare_ssl(shape: tuple[int, int], seed: int, count: int = 1000) -> Comparison:
    """The structural term on all matches at once against scikit-image's SSIM called once a match."""
    from skimage.metrics import structural_similarity

    from asfm.frontend.ssl import stretch_patches, structural_spatial_loss

    config = SslConfig(spatial_weight=0.0)
    size = 2 * config.radius_px + 1
    rng, image = np.random.default_rng(seed), make_speckle(shape, seed)
    corners = np.stack([rng.integers(0, length - size, 2 * count) for length in shape], axis=1)
    patches = np.stack([image[row : row + size, column : column + size] for row, column in corners])
    patches_a, patches_b = patches[:count], patches[count:]

    def with_skimage() -> Array:
        pairs = zip(stretch_patches(patches_a), stretch_patches(patches_b), strict=True)
        return np.array([0.5 - 0.5 * structural_similarity(a, b, data_range=1.0) for a, b in pairs])

    ours = partial(structural_spatial_loss, patches_a, patches_b, config)
    return Comparison(f"structural loss of {count} matches", ours, {"scikit-image SSIM loop": with_skimage}, 0.0)


COMPARISONS: dict[str, Callable[[tuple[int, int], int], Comparison]] = {
    "cfar": compare_cfar,
    "clusters": compare_clusters,
    "ssl": compare_ssl,
}


def time_in_turns(contenders: dict[str, Callable[[], Array]], rounds: int) -> dict[str, float]:
    """Call all contenders in each round; returns the median time in seconds of each."""
    spent: dict[str, list[float]] = {name: [] for name in contenders}
    for _ in range(rounds):
        for name, run in contenders.items():
            start = time.perf_counter()
            run()
            spent[name].append(time.perf_counter() - start)
    return {name: float(np.median(times)) for name, times in spent.items()}


def report(comparison: Comparison, rounds: int) -> bool:
    """Print the medians, their ratios and whether the results agree; returns whether all of them do."""
    expected, agree = comparison.ours(), True
    print(comparison.title)
    medians = time_in_turns({"asfm": comparison.ours, **comparison.peers}, rounds)
    print(f"  {'asfm':<26}{1e3 * medians['asfm']:>10.2f} ms")
    for name, run in comparison.peers.items():
        different = 1 - float(np.mean(np.isclose(expected, run(), atol=1e-6)))
        agree &= different <= comparison.tolerance
        verdict = f"{100 * different:.4g} % of the results differ" if different else "same results"
        print(f"  {name:<26}{1e3 * medians[name]:>10.2f} ms   {medians[name] / medians['asfm']:.1f} x   {verdict}")
    return agree


def main(arguments: list[str] | None = None) -> int:
    """Run what the command line names; returns 1 where results disagree or a run fails."""
    options = make_parser().parse_args(arguments)
    if options.what == "run":
        return _report_run(options)
    if options.what == "reach":
        lines, all_ran = tabulate_reach(options.data, options.recording)
        print("\n".join(lines))
        return 0 if all_ran else 1
    cv2.setNumThreads(options.threads)
    names = list(COMPARISONS) if options.what == "all" else [options.what]
    agree = [report(COMPARISONS[name](tuple(options.shape), options.seed), options.rounds) for name in names]
    return 0 if all(agree) else 1


def make_parser() -> argparse.ArgumentParser:
    """Make the parser: one sub-command for each comparison and for all of them, for a run, for the public runs."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    commands = parser.add_subparsers(dest="what", required=True, metavar="WHAT")
    for name in (*COMPARISONS, "all"):
        command = commands.add_parser(name, help="every comparison" if name == "all" else f"compare {name}")
        command.add_argument("--shape", type=int, nargs=2, default=(600, 256), metavar=("RANGES", "BEAMS"))
        command.add_argument("--rounds", type=int, default=9)
        command.add_argument("--seed", type=int, default=0)
        command.add_argument("--threads", type=int, default=1, help="threads of OpenCV; the peers use one")
    run = commands.add_parser("run", help="measure one asfm run")
    run.add_argument("sequence", type=Path)
    run.add_argument("--set", dest="settings", action="append", default=[], metavar="SECTION.KEY=VALUE")
    reach = commands.add_parser("reach", help="measure the public runs, in one table")
    reach.add_argument("data", type=Path, metavar="DATA_FOLDER")
    for command in (run, reach):
        command.add_argument("--recording", action="store_true", help="with the viewer's recording, which takes longer")
    return parser


def _report_run(options: argparse.Namespace) -> int:
    try:
        lines = describe_run(measure_run(options.sequence, options.settings, options.recording))
    except RunFailed as failure:
        print(failure, file=sys.stderr)
        return 1
    print("\n".join(lines))
    return 0


def _detect(image: ImageArray) -> BoolArray:
    from asfm.frontend.cfar import detect_cfar

    return detect_cfar(image, np.ones(image.shape, dtype=bool), CfarConfig())


if __name__ == "__main__":
    raise SystemExit(main())
