"""Native GTSAM factors against factors in Python, and the printed times of the back-end."""

import gtsam
import numpy as np
import pytest

import tools.benchmark.__main__ as benchmark
from asfm.backend.graph.factors import bearing_factor, range_factor
from tools.benchmark.native_factors import compare_factors, make_bearing_factor, make_range_factor


@pytest.mark.parametrize("kind", ["bearing", "range"])
def test_factors_in_python_agree_with_the_native_ones(kind: str) -> None:
    """Same error and same whitened Jacobians, robust kernel included, at random poses and points."""
    rng = np.random.default_rng(4)
    native = {"bearing": bearing_factor, "range": range_factor}[kind]
    python = {"bearing": make_bearing_factor, "range": make_range_factor}[kind]
    for _ in range(5):
        values = gtsam.Values()
        pose = gtsam.Pose3.Expmap(rng.normal(size=6))
        values.insert(0, pose)
        values.insert(1, pose.transformFrom(np.array([3.0, 0.5, 0.4]) + 0.2 * rng.normal(size=3)))
        reading = 3.0 if kind == "range" else 0.1
        ours, theirs = python(0, 1, reading, 0.02), native(0, 1, reading, 0.02, gtsam.Pose3())
        assert ours.error(values) == pytest.approx(theirs.error(values), rel=1e-9)
        for mine, other in zip(ours.linearize(values).jacobian(), theirs.linearize(values).jacobian(), strict=True):
            np.testing.assert_allclose(mine, other, atol=1e-8)


def test_backend_speed_is_printed(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(benchmark, "compare_factors", lambda: compare_factors(6, 15))
    code = benchmark.main(["backend-speed", "--frames", "12", "--observations", "10"])
    lines = {line.split("  ")[0]: line.split() for line in capsys.readouterr().out.splitlines()}
    assert lines["native factors, largest pose difference from that optimum"][-1] == "yes", "both solve the same"
    assert code == (1 if lines["native factors, faster"][-1] == "NO" else 0)
    seconds = {name: float(cells[-2]) for name, cells in lines.items() if cells[-1] == "s"}
    rounds = sum(value for name, value in seconds.items() if ", round" in name)
    assert lines["12 frames, in all"][-1] == "yes"
    assert float(lines["12 frames, in all"][-3]) == pytest.approx(rounds + seconds["12 frames, landmarks"], rel=0.02)
    assert 50 < float(lines["12 frames, peak memory"][-3].replace(",", "")) < 3000
