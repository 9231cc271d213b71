"""Self-calibration recovers a rotated mounting and a range bias, and changes nothing that is not selected."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.backend.graph.problem import BundleProblem
from asfm.backend.graph.self_calibration import calibrate
from asfm.config import BackendConfig
from asfm.geometry.poses import invert, make_pose, transform
from asfm.geometry.sonar import SonarModel, project
from asfm.navigation.sensor_constraints import SensorConstraints
from asfm.types import FloatArray, Tracks

SONAR = SonarModel.evenly_spaced("test", (0.5, 10.0), (-0.7, 0.7), (500, 128), np.deg2rad(20))
LEVER_ARM = make_pose(np.array([0.4, -0.1, -0.2]), Rotation.from_euler("ZYX", [0.0, 0.4, 0.0]))
FRAMES = 12


def make_problem(bias_m: float = 0.0) -> tuple[BundleProblem, FloatArray, FloatArray]:
    """A vehicle with accurate odometry that rolls and turns over a floor."""
    rng = np.random.default_rng(0)
    angles = rng.uniform([-0.2, -0.2, -0.3], [0.2, 0.2, 0.3], (FRAMES, 3))
    place = rng.uniform([-0.5, -0.5, 1.8], [0.5, 0.5, 2.2], (FRAMES, 3))
    poses = make_pose(place, Rotation.from_euler("ZYX", angles))
    xyz_m = rng.uniform([2.5, -1.5, -0.2], [5.5, 1.5, 0.2], (40, 3))
    seen = transform(invert(poses @ LEVER_ARM), xyz_m[:, None])
    track, frame = np.nonzero(np.ones(seen.shape[:2]))
    range_m, bearing_rad, _ = project(seen[track, frame])
    error = rng.normal(0, [0.005, 0.002], (len(track), 2))
    tracks = Tracks(track, frame, range_m + bias_m + error[:, 0], bearing_rad + error[:, 1])
    sensors = SensorConstraints(
        poses[0],
        np.full(6, 1e-6),
        True,
        invert(poses[:-1]) @ poses[1:],
        np.tile([0.001, 0.005], (FRAMES - 1, 1)),
        np.zeros((0, 3)),
        np.zeros((0, 3)),
    )
    sigma = np.tile([0.005, 0.002], (len(tracks), 1))
    problem = BundleProblem(tracks, np.ones(len(tracks), dtype=bool), sigma, sensors, LEVER_ARM, 0.6)
    return problem, poses, xyz_m


def test_a_rotated_mounting_is_recovered() -> None:
    problem, poses, xyz_m = make_problem()
    truth = np.deg2rad([1.0, -2.0, 1.5])
    turn = make_pose(np.zeros(3), Rotation.from_rotvec(truth))
    given = replace(problem, vehicle_from_sonar=LEVER_ARM @ invert(turn))
    found = calibrate(given, poses, xyz_m, BackendConfig(estimate_lever_rotation=True))
    np.testing.assert_allclose(found.rotation_rad, truth, atol=np.deg2rad(0.4))
    assert (np.abs(found.rotation_rad - truth) < 4 * found.sigma[:3]).all()
    np.testing.assert_allclose(found.correct_mounting(given.vehicle_from_sonar), LEVER_ARM, atol=0.007)
    assert found.range_bias_m == 0
    (diagnostic,) = found.diagnose()
    assert diagnostic.code == "estimated-lever-rotation" and diagnostic.severity == "info"
    assert "deg about y" in diagnostic.message


@pytest.mark.parametrize("bias_m", [0.06, -0.04])
def test_a_range_bias_is_recovered(bias_m: float) -> None:
    problem, poses, xyz_m = make_problem(bias_m)
    found = calibrate(problem, poses, xyz_m, BackendConfig(estimate_range_bias=True))
    assert found.range_bias_m == pytest.approx(bias_m, abs=min(0.01, 4 * found.sigma[3]))
    assert not found.rotation_rad.any() and not found.sigma[:3].any()
    (diagnostic,) = found.diagnose()
    assert diagnostic.code == "estimated-range-bias" and diagnostic.severity == "info"
    assert f"{found.range_bias_m:+.3f} +- {found.sigma[3]:.3f} m" in diagnostic.message


def test_nothing_selected_nothing_estimated() -> None:
    problem, poses, xyz_m = make_problem()
    found = calibrate(problem, poses, xyz_m, BackendConfig())
    assert not found.rotation_rad.any() and found.range_bias_m == 0 and found.diagnose() == ()


def test_a_sonar_at_rest_keeps_the_mounting_with_the_sigma_of_the_prior() -> None:
    problem, poses, xyz_m = make_problem()
    still = np.repeat(poses[:1], FRAMES, axis=0)
    seen = transform(invert(still @ LEVER_ARM), xyz_m[:, None])
    range_m, bearing_rad, _ = project(seen)
    sensors = replace(problem.sensors, steps=np.repeat(np.eye(4)[None], FRAMES - 1, axis=0))
    tracks = replace(problem.tracks, range_m=range_m.ravel(), bearing_rad=bearing_rad.ravel())
    config = BackendConfig(estimate_lever_rotation=True, estimate_range_bias=True)
    found = calibrate(replace(problem, sensors=sensors, tracks=tracks), still, xyz_m, config)
    assert np.isfinite(found.sigma).all() and np.abs(found.rotation_rad).max() < 0.02
    assert found.sigma[0] > 0.05, "the data add nothing to the prior"


def calibrate_bias(monkeypatch: pytest.MonkeyPatch, cost: Callable[[float], float]) -> tuple[float, float]:
    """Return the range bias and its sigma where the cost of the adjusted bundle is a known function of the bias."""
    problem, poses, xyz_m = make_problem()

    def adjust(corrected: BundleProblem, *_: object) -> SimpleNamespace:
        bias_m = float(np.mean(problem.tracks.range_m - corrected.tracks.range_m))
        return SimpleNamespace(values=None, graph=SimpleNamespace(error=lambda _: cost(bias_m)))

    monkeypatch.setattr("asfm.backend.graph.self_calibration.adjust_bundle", adjust)
    found = calibrate(problem, poses, xyz_m, BackendConfig(estimate_range_bias=True))
    return found.range_bias_m, float(found.sigma[3])


@pytest.mark.parametrize("information", [25.0, 400.0])
def test_estimate_and_sigma_are_those_of_a_gaussian_prior_and_likelihood(
    monkeypatch: pytest.MonkeyPatch, information: float
) -> None:
    """The prior has a sigma of 0.2 m, and so an information of 25."""
    bias_m, sigma_m = calibrate_bias(monkeypatch, lambda bias_m: 0.5 * information * (bias_m - 0.06) ** 2)
    assert bias_m == pytest.approx(0.06 * information / (information + 25), abs=1e-6)
    assert sigma_m == pytest.approx((information + 25) ** -0.5, rel=1e-6)


def test_steps_stay_near_the_probes_and_those_that_raise_the_cost_are_not_made(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Two steps of three probes of 0.03 m each; beyond a wall the parabola is wrong."""
    far_m, _ = calibrate_bias(monkeypatch, lambda bias_m: 1e6 * (bias_m - 0.5) ** 2)
    assert far_m == pytest.approx(0.18)
    walled_m, _ = calibrate_bias(monkeypatch, lambda bias_m: 1e4 * (bias_m - 0.08) ** 2 + 1e9 * (bias_m > 0.05))
    assert walled_m == 0.0
