"""Fit the simulator's background noise to recorded pings of empty water.

Run as ``python -m tools.calibration.fit_noise SEQUENCE``, where SEQUENCE is a sequence of any format, or a bare
folder of 8- or 16-bit grey PNGs (rows are ranges) with ``--range NEAR FAR``. Prints the values for ImagingSonar
(AddSigma, near_sigma, near_exponent, threshold, azimuth_edge_db) and how far the
fitted distribution is from the recorded one (Kolmogorov's distance, over all pixels and by zones of range).

The model is the simulator's own (asfm/simulation/acoustics/receiver.py): Rayleigh noise whose power is the
receiver's plus the water's reverberation, which falls with range and off the axis; the
sonar takes a threshold off and cuts what is below.
Maximum likelihood over counts, so that the pile of zeros below the threshold counts as what it is. Speckle cannot be
seen in empty water: MultSigma is not fitted.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from asfm.errors import AsfmError
from asfm.simulation.acoustics.receiver import background_sigma
from asfm.simulation.sonars.parameters import ImagingSonar, make_sonar_model
from asfm.simulation.sonars.presets import PRESETS
from asfm.types import FloatArray, IntArray

ZONES, COLUMNS, REPORTED_ZONES = 16, 96, 4
FITTED = ("add_sigma", "near_sigma", "near_exponent", "threshold", "azimuth_edge_db")
START = np.array([np.log(0.03), np.log(0.07), 1.0, 0.05, -15.0])
"""The same, the sigmas as logarithms."""


@dataclass(frozen=True)
class Counts:
    """Histograms of pixel counts by cells of the image: ``histogram`` is (zones, columns, 256)."""

    histogram: IntArray
    range_m: FloatArray
    """(zones,) middle of each."""
    off_axis: FloatArray
    """(columns,) bearing over the outermost bearing."""


@dataclass(frozen=True)
class Fit:
    """A sonar with the fitted noise, and how well it fits."""

    sonar: ImagingSonar
    distance: float
    """Kolmogorov's distance over all pixels."""
    zone_distances: tuple[float, ...]


def read_pings(path: Path) -> FloatArray:
    """Read a sequence, or a folder of PNGs, as (pings, ranges, beams) of 0..255."""
    import cv2

    from asfm.datasets import open_sequence

    files = sorted(path.glob("*.png")) if not (path / "sequence.yaml").exists() else []
    if files:
        images = [np.asarray(cv2.imread(str(file), cv2.IMREAD_UNCHANGED)) for file in files]
        if any(image.ndim != 2 or image.shape != images[0].shape for image in images):
            raise AsfmError(f"{path}: expected grey images of one size")
        return np.stack([image * (255.0 / np.iinfo(image.dtype).max) for image in images])
    return np.stack([255.0 * frame.image for frame in open_sequence(path)])


def gather_counts(pings: FloatArray, sonar: ImagingSonar) -> Counts:
    """Sort the pixels of (pings, ranges, beams) of 0..255 into cells of the image."""
    model = make_sonar_model(sonar)
    rows = np.array_split(np.arange(pings.shape[1]), ZONES)
    columns = np.array_split(np.arange(pings.shape[2]), COLUMNS)
    counts = np.round(pings).astype(np.int64)
    histogram = [[np.bincount(counts[:, r][:, :, c].ravel(), minlength=256) for c in columns] for r in rows]
    off_axis = model.bearing_rad / np.abs(model.bearing_rad).max()
    return Counts(
        np.array(histogram),
        np.array([model.range_m[r].mean() for r in rows]),
        np.array([np.sqrt((off_axis[c] ** 2).mean()) for c in columns]),
    )


def predict_shares(sigma: FloatArray, threshold: float) -> FloatArray:
    """Share of each of 256 counts of Rayleigh noise less a threshold: sigma's shape + (256,)."""
    edges = (np.arange(255) + 0.5) / 255 + threshold
    below = -np.expm1(-0.5 * (edges / sigma[..., None]) ** 2)
    return np.diff(below, axis=-1, prepend=0.0, append=1.0)


def fit_noise(pings: FloatArray, sonar: ImagingSonar) -> Fit:
    """Fit the background of a sonar to (pings, ranges, beams) of 0..255."""
    counts = gather_counts(pings, sonar)
    nearest_m = max(sonar.range_min, make_sonar_model(sonar).range_step_m)

    def misfit(values: FloatArray) -> float:
        noise = name_values(values)
        if not 0 <= noise["threshold"] < 1 or noise["azimuth_edge_db"] > 0 or noise["near_exponent"] < 0:
            return 1e12
        fall = (nearest_m / np.maximum(counts.range_m, nearest_m)) ** noise["near_exponent"]
        pattern = 10 ** (noise["azimuth_edge_db"] * counts.off_axis**2 / 10)
        sigma = np.sqrt(noise["add_sigma"] ** 2 + (noise["near_sigma"] * fall[:, None]) ** 2 * pattern)
        shares = predict_shares(sigma, noise["threshold"])
        return -float((counts.histogram * np.log(np.maximum(shares, 1e-12))).sum() / counts.histogram.sum())

    best = minimize(misfit, START, method="Nelder-Mead", options={"maxiter": 4000, "xatol": 1e-5, "fatol": 1e-10})
    return judge_fit(pings, sonar.model_copy(update=name_values(best.x)))


def name_values(values: FloatArray) -> dict[str, float]:
    """Turn what is optimised, (5,) as START, into the sonar's parameters."""
    return dict(zip(FITTED, (*np.exp(values[:2]).tolist(), *values[2:].tolist()), strict=True))


def judge_fit(pings: FloatArray, sonar: ImagingSonar) -> Fit:
    """Measure how far a sonar's background is from (pings, ranges, beams) of 0..255."""
    sigma = np.broadcast_to(background_sigma(sonar, make_sonar_model(sonar)), pings.shape[1:]).astype(float)
    shares = np.cumsum(predict_shares(sigma, sonar.threshold), axis=-1)
    counts = np.round(pings).astype(np.int64)

    def distance(rows: slice) -> float:
        found = np.cumsum(np.bincount(counts[:, rows].ravel(), minlength=256)) / counts[:, rows].size
        return float(np.abs(found - shares[rows].mean(axis=(0, 1))).max())

    edges = np.linspace(0, pings.shape[1], REPORTED_ZONES + 1).astype(int)
    zones = tuple(distance(slice(low, high)) for low, high in pairwise(edges))
    return Fit(sonar, distance(slice(None)), zones)


def describe_fit(title: str, fit: Fit) -> str:
    """Say in two lines what was fitted and how well."""
    values = ", ".join(f"{key} {getattr(fit.sonar, key):.4g}" for key in FITTED)
    by_range = " ".join(f"{distance:.4f}" for distance in fit.zone_distances)
    return f"{title:8s} {values}\n{'':8s} Kolmogorov's distance {fit.distance:.4f}; by range {by_range}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Fit, and print."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.calibration.fit_noise", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("sequence", type=Path)
    parser.add_argument("--sonar", default="didson", choices=sorted(PRESETS), help="preset whose grid the pings have")
    parser.add_argument("--range", nargs=2, type=float, metavar=("NEAR", "FAR"), help="where they differ from its own")
    chosen = parser.parse_args(arguments)
    sonar = PRESETS[chosen.sonar]
    if chosen.range:
        sonar = sonar.model_copy(update={"range_min": chosen.range[0], "range_max": chosen.range[1]})
    try:
        pings = read_pings(chosen.sequence)
        if pings.shape[2] != sonar.azimuth_bins:
            raise AsfmError(f"{chosen.sequence}: expected {sonar.azimuth_bins} beams, found {pings.shape[2]}")
    except AsfmError as error:
        print(f"fit_noise: {error}")
        return 2
    sonar = sonar.model_copy(update={"range_bins": pings.shape[1]})
    print(describe_fit("shipped", judge_fit(pings, sonar)))
    print(describe_fit("fitted", fit_noise(pings, sonar)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
