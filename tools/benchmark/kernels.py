"""Kernels of the front-end against independent implementations: CFAR, DBSCAN, SSL."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asfm.config import CfarConfig, DbscanConfig, SslConfig
from asfm.types import BoolArray, ImageArray

Array = NDArray[Any]


@dataclass(frozen=True)
class Comparison:
    """One kernel and its peers, which compute the same."""

    title: str
    ours: Callable[[], Array]
    peers: dict[str, Callable[[], Array]]
    tolerance: float
    """Largest fraction of the values that may differ: a rounding error decides at a threshold."""


def time_in_turns(
    contenders: dict[str, Callable[[], Array]], rounds: int, clock: Callable[[], float] = time.perf_counter
) -> dict[str, float]:
    """Call all contenders in turn, round by round; return the median time in seconds of each."""
    spent: dict[str, list[float]] = {name: [] for name in contenders}
    for _ in range(rounds):
        for name, run in contenders.items():
            start = clock()
            run()
            spent[name].append(clock() - start)
    return {name: float(np.median(times)) for name, times in spent.items()}


def make_speckle(shape: tuple[int, int], seed: int) -> ImageArray:
    """Simulate Rayleigh noise, stronger at close range, with a hundred bright squares: (ranges, beams) in 0..1."""
    rng = np.random.default_rng(seed)
    strength = np.linspace(2.0, 1.0, shape[0])[:, None] * np.ones(shape)
    for row, column in zip(rng.integers(0, shape[0], 100), rng.integers(0, shape[1], 100), strict=True):
        strength[row : row + 6, column : column + 6] *= 6
    image = rng.rayleigh(size=shape) * strength
    return np.asarray(image / image.max(), dtype=np.float32)


def compare_cfar(shape: tuple[int, int], seed: int) -> Comparison:
    """Compare cell-averaging CFAR with the same in terms of SciPy's uniform filter."""
    from scipy.ndimage import uniform_filter

    image, config = make_speckle(shape, seed), CfarConfig()

    def sum_box(values: Array, half_px: tuple[int, int]) -> Array:
        size = (2 * half_px[0] + 1, 2 * half_px[1] + 1)
        return np.asarray(uniform_filter(values, size, mode="constant") * (size[0] * size[1]))

    def with_scipy() -> Array:
        power, ones = image.astype(float) ** 2, np.ones(shape)
        total = sum_box(power, config.reference_px) - sum_box(power, config.guard_px)
        count = np.rint(sum_box(ones, config.reference_px) - sum_box(ones, config.guard_px))
        factor = count * (config.false_alarm_probability ** (-1 / count) - 1)
        return np.asarray(power > factor * total / count)

    return _compare_detections("cell averaging", config, image, "scipy uniform_filter", with_scipy)


def compare_goca_soca(shape: tuple[int, int], seed: int, greatest: bool) -> Comparison:
    """Compare GOCA or SOCA CFAR with SciPy's convolution by FFT, with asfm's threshold factors."""
    from scipy.signal import fftconvolve

    from asfm.frontend.denoising.cfar_factors import lookup_goca_soca_factors

    config = CfarConfig.model_validate({"method": "goca" if greatest else "soca"})
    image, (rows, columns) = make_speckle(shape, seed), config.reference_px
    before = _make_ring(config)
    before[: rows + 1] = False  # a convolution reverses its kernel: the farther rows sum the leading cells

    def with_scipy() -> Array:
        power = image.astype(float) ** 2
        halves = (before.astype(float), before[::-1].astype(float))
        sums = [fftconvolve(power, half, mode="same") for half in halves]
        counts = [np.rint(fftconvolve(np.ones(shape), half, mode="same")).astype(int) for half in halves]
        largest = rows * (2 * columns + 1)
        factor = lookup_goca_soca_factors(counts[0], counts[1], largest, config.false_alarm_probability, greatest)
        empty = 0.0 if greatest else np.inf
        means = [np.where(n > 0, total / np.maximum(n, 1), empty) for total, n in zip(sums, counts, strict=True)]
        return np.asarray(power > factor * (np.maximum(*means) if greatest else np.minimum(*means)))

    title = f"{'greatest' if greatest else 'smallest'} of halves"
    return _compare_detections(title, config, image, "scipy fftconvolve", with_scipy)


def compare_order(shape: tuple[int, int], seed: int) -> Comparison:
    """Compare order-statistic CFAR with SciPy's rank filter, with asfm's threshold factors."""
    from scipy.ndimage import rank_filter

    from asfm.frontend.denoising.cfar import detect_cfar
    from asfm.frontend.denoising.cfar_factors import order_ranks, os_factors
    from asfm.frontend.denoising.cfar_windows import count_reference_cells

    config = CfarConfig(method="os")
    image, ring = make_speckle(shape, seed), _make_ring(config)
    everywhere = np.ones(shape, dtype=bool)
    whole = np.array([ring.sum()])
    # At the border the rank differs from pixel to pixel, while SciPy has one for all: it is left out.
    inside = count_reference_cells(everywhere, config.reference_px, config.guard_px) == whole

    def with_scipy() -> Array:
        power = image.astype(float) ** 2
        rank = int(order_ranks(whole, config.order_fraction)[0])
        factor = float(os_factors(whole, config.false_alarm_probability, config.order_fraction)[0])
        statistic = rank_filter(power, rank=rank - 1, footprint=ring, mode="constant", cval=np.inf)
        return np.asarray((power > factor * statistic) & inside)

    def with_asfm() -> Array:
        return np.asarray(detect_cfar(image, everywhere, config) & inside)

    title = f"order statistic CFAR, {shape[0]} x {shape[1]}"
    return Comparison(title, with_asfm, {"scipy rank_filter": with_scipy}, 1e-4)


def compare_clusters(shape: tuple[int, int], seed: int, labels: bool = False) -> Comparison:
    """Compare DBSCAN on the grid, mask or labels, with scikit-learn's on the coordinates of a tenth of the pixels."""
    from sklearn.cluster import DBSCAN

    from asfm.frontend.denoising.dbscan import dbscan_labels, dbscan_mask

    image, config = make_speckle(shape, seed), DbscanConfig()
    detections = np.asarray(image > np.quantile(image, 0.9))

    def with_sklearn() -> Array:
        where = np.argwhere(detections)
        found = np.full(shape, -1)
        found[tuple(where.T)] = DBSCAN(eps=config.radius_px, min_samples=config.min_pixels).fit_predict(where)
        return found if labels else np.asarray(found >= 0)

    ours: Callable[..., Array] = dbscan_labels if labels else dbscan_mask
    title = f"DBSCAN {'labels' if labels else 'noise'} of {detections.sum()} pixels, {shape[0]} x {shape[1]}"
    return Comparison(title, partial(ours, detections, config), {"scikit-learn DBSCAN": with_sklearn}, 0.0)


def compare_ssl(shape: tuple[int, int], seed: int, count: int = 1000) -> Comparison:
    """Compare the structural loss of all matches at once with scikit-image's SSIM, called once a match."""
    from skimage.metrics import structural_similarity

    from asfm.frontend.matching.ssl import stretch_patches, structural_spatial_loss

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
    "cfar-goca": partial(compare_goca_soca, greatest=True),
    "cfar-soca": partial(compare_goca_soca, greatest=False),
    "cfar-os": compare_order,
    "clusters": compare_clusters,
    "clusters-labels": partial(compare_clusters, labels=True),
    "ssl": compare_ssl,
}


def choose_comparisons(what: str) -> list[str]:
    """Return the names that are equal to a name or begin with it before a hyphen, or ``all`` of them."""
    return [name for name in COMPARISONS if what in ("all", name, name.partition("-")[0])]


def _compare_detections(
    title: str, config: CfarConfig, image: ImageArray, peer: str, with_peer: Callable[[], Array]
) -> Comparison:
    from asfm.frontend.denoising.cfar import detect_cfar

    ours = partial(detect_cfar, image, np.ones(image.shape, dtype=bool), config)
    return Comparison(f"{title} CFAR, {image.shape[0]} x {image.shape[1]}", ours, {peer: with_peer}, 1e-4)


def _make_ring(config: CfarConfig) -> BoolArray:
    """Return the reference window, true in the reference cells and false in the guard window."""
    (rows, columns), (guard_rows, guard_columns) = config.reference_px, config.guard_px
    row, column = np.mgrid[-rows : rows + 1, -columns : columns + 1]
    return np.asarray((np.abs(row) > guard_rows) | (np.abs(column) > guard_columns))
