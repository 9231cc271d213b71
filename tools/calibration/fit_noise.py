"""Maximum-likelihood fit of the simulator's background noise to recorded pings of empty water.

Run as ``python -m tools.calibration.fit_noise SEQUENCE``, where SEQUENCE is a sequence of any format, or a bare
folder of 8- or 16-bit grey PNGs (rows are ranges) with ``--range NEAR FAR``. Prints the values for ImagingSonar
(AddSigma, near_sigma, near_exponent, threshold, azimuth_edge_db) and the Kolmogorov-Smirnov distance of the fitted
distribution from the recorded one, over all pixels and by zones of range.

The model is the simulator's (asfm/simulation/acoustics/noise.py): Rayleigh noise whose power is the receiver's plus
the water's reverberation, which falls with range and off the axis; the sonar subtracts a threshold and clips at zero.
The likelihood is that of the pixel counts, so that the zeros below the threshold are modelled too. Empty water has no
speckle: MultSigma is not fitted.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from asfm.errors import AsfmError
from asfm.simulation.acoustics.noise import background_sigma
from asfm.simulation.sonars.parameters import ImagingSonar, make_sonar_model
from asfm.simulation.sonars.presets import PRESETS
from asfm.types import FloatArray, IntArray

ZONES, COLUMNS, REPORTED_ZONES = 16, 96, 4
FITTED = ("add_sigma", "near_sigma", "near_exponent", "threshold", "azimuth_edge_db")
INITIAL = np.array([np.log(0.03), np.log(0.07), 1.0, 0.05, -15.0])
"""Initial values of FITTED, the sigmas as logarithms."""


@dataclass(frozen=True)
class Counts:
    """Histograms of pixel counts in cells of the image."""

    histogram: IntArray
    """(zones, columns, 256)"""
    range_m: FloatArray
    """(zones,) mean range of each."""
    off_axis: FloatArray
    """(columns,) RMS bearing over the outermost bearing."""


@dataclass(frozen=True)
class Fit:
    """A sonar with fitted noise, and its distance from the recorded distribution."""

    sonar: ImagingSonar
    distance: float
    """Kolmogorov-Smirnov distance over all pixels."""
    zone_distances: tuple[float, ...]
    """The same by zones of range."""


def read_pings(path: Path) -> FloatArray:
    """Read a sequence, or a folder of PNGs, as (pings, ranges, beams) of 0..255.

    Raises:
        AsfmError: the images differ in size, or the path is no sequence.
    """
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
    """Count the pixels of (pings, ranges, beams) of 0..255 in cells of the image."""
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


def count_probabilities(sigma: FloatArray, threshold: float) -> FloatArray:
    """Return the probability of each of 256 counts of Rayleigh noise minus a threshold: shape of sigma + (256,)."""
    edges = (np.arange(255) + 0.5) / 255 + threshold
    below = -np.expm1(-0.5 * (edges / sigma[..., None]) ** 2)
    return np.diff(below, axis=-1, prepend=0.0, append=1.0)


def fit_noise(pings: FloatArray, sonar: ImagingSonar) -> Fit:
    """Fit the background noise of a sonar to (pings, ranges, beams) of 0..255 by maximum likelihood."""
    counts = gather_counts(pings, sonar)
    nearest_m = max(sonar.range_min, make_sonar_model(sonar).range_step_m)

    def negative_log_likelihood(values: FloatArray) -> float:
        noise = to_parameters(values)
        if not 0 <= noise["threshold"] < 1 or noise["azimuth_edge_db"] > 0 or noise["near_exponent"] < 0:
            return 1e12
        fall = (nearest_m / np.maximum(counts.range_m, nearest_m)) ** noise["near_exponent"]
        pattern = 10 ** (noise["azimuth_edge_db"] * counts.off_axis**2 / 10)
        sigma = np.sqrt(noise["add_sigma"] ** 2 + (noise["near_sigma"] * fall[:, None]) ** 2 * pattern)
        shares = count_probabilities(sigma, noise["threshold"])
        return -float((counts.histogram * np.log(np.maximum(shares, 1e-12))).sum() / counts.histogram.sum())

    best = minimize(
        negative_log_likelihood, INITIAL, method="Nelder-Mead", options={"maxiter": 4000, "xatol": 1e-5, "fatol": 1e-10}
    )
    return measure_fit(pings, sonar.model_copy(update=to_parameters(best.x)))


def to_parameters(values: FloatArray) -> dict[str, float]:
    """Convert optimised values, (5,) as INITIAL, into parameters of the sonar."""
    return dict(zip(FITTED, (*np.exp(values[:2]).tolist(), *values[2:].tolist()), strict=True))


def measure_fit(pings: FloatArray, sonar: ImagingSonar) -> Fit:
    """Measure the distance of a sonar's background noise from (pings, ranges, beams) of 0..255."""
    sigma = np.broadcast_to(background_sigma(sonar, make_sonar_model(sonar)), pings.shape[1:]).astype(float)
    shares = np.cumsum(count_probabilities(sigma, sonar.threshold), axis=-1)
    counts = np.round(pings).astype(np.int64)

    def distance(rows: slice) -> float:
        found = np.cumsum(np.bincount(counts[:, rows].ravel(), minlength=256)) / counts[:, rows].size
        return float(np.abs(found - shares[rows].mean(axis=(0, 1))).max())

    edges = np.linspace(0, pings.shape[1], REPORTED_ZONES + 1).astype(int)
    zones = tuple(distance(slice(low, high)) for low, high in pairwise(edges))
    return Fit(sonar, distance(slice(None)), zones)


def describe_fit(title: str, fit: Fit) -> str:
    """Return two lines: the parameters and the distances."""
    values = ", ".join(f"{key} {getattr(fit.sonar, key):.4g}" for key in FITTED)
    by_range = " ".join(f"{distance:.4f}" for distance in fit.zone_distances)
    return f"{title:8s} {values}\n{'':8s} Kolmogorov-Smirnov distance {fit.distance:.4f}; by range {by_range}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Fit the noise and print it beside the shipped one."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.calibration.fit_noise", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("sequence", type=Path, help="sequence of any format, or folder of PNGs")
    parser.add_argument(
        "--sonar", default="didson", choices=sorted(PRESETS), help="preset with the pixel grid of the pings"
    )
    parser.add_argument(
        "--range",
        nargs=2,
        type=float,
        metavar=("NEAR", "FAR"),
        help="range edges in metres, where they differ from the preset's",
    )
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
    print(describe_fit("shipped", measure_fit(pings, sonar)))
    print(describe_fit("fitted", fit_noise(pings, sonar)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
