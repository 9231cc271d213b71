"""trajectory.tum: read back by independent readers."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from asfm.geometry.poses import make_pose, tum_from_pose
from asfm.results.trajectory_tum import read_trajectory, write_trajectory
from asfm.types import Trajectory


def make_trajectory(count: int, start_s: float = 0.0, seed: int = 0) -> Trajectory:
    rng = np.random.default_rng(seed)
    stamps = start_s + np.cumsum(rng.uniform(1e-3, 1.0, count))
    return Trajectory(stamps, make_pose(rng.normal(0, 100, (count, 3)), Rotation.random(count, rng)))


@given(count=st.integers(1, 20), start_s=st.sampled_from([0.0, 1.7e9]), seed=st.integers(0, 99))
@settings(max_examples=20, deadline=None)
def test_trajectory_read_by_numpy(
    count: int, start_s: float, seed: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    trajectory = make_trajectory(count, start_s, seed)
    path = tmp_path_factory.mktemp("tum") / "trajectory.tum"
    write_trajectory(path, trajectory)
    rows = np.loadtxt(path, ndmin=2)
    np.testing.assert_array_equal(rows[:, 0], trajectory.timestamps_s)
    np.testing.assert_allclose(rows[:, 1:], tum_from_pose(trajectory.world_from_vehicle), atol=6e-10)


def test_trajectory_read_by_evo(tmp_path: Path) -> None:
    file_interface = pytest.importorskip("evo.tools.file_interface")
    trajectory = make_trajectory(30, 1.7e9)
    write_trajectory(tmp_path / "trajectory.tum", trajectory)
    read = file_interface.read_tum_trajectory_file(str(tmp_path / "trajectory.tum"))
    assert read.check()[0]
    np.testing.assert_array_equal(read.timestamps, trajectory.timestamps_s)
    np.testing.assert_allclose(np.stack(read.poses_se3), trajectory.world_from_vehicle, atol=1e-8)


def test_trajectory_text_is_tidy(tmp_path: Path) -> None:
    path = tmp_path / "trajectory.tum"
    pose = make_pose(np.array([[-1e-12, 2.0, 3.0]]), Rotation.identity(1))
    write_trajectory(path, Trajectory(np.array([0.2]), pose))
    assert path.read_text() == (
        "# timestamp x y z qx qy qz qw\n"
        "0.2 0.000000000 2.000000000 3.000000000 0.000000000 0.000000000 0.000000000 1.000000000\n"
    )


def test_trajectory_with_nan_is_a_defect(tmp_path: Path) -> None:
    trajectory = make_trajectory(3)
    trajectory.world_from_vehicle[1, 0, 3] = np.nan
    with pytest.raises(ValueError, match="row 1"):
        write_trajectory(tmp_path / "trajectory.tum", trajectory)
    assert not list(tmp_path.iterdir())


def test_trajectory_reads_back(tmp_path: Path) -> None:
    trajectory = make_trajectory(20, 1.7e9)
    write_trajectory(tmp_path / "trajectory.tum", trajectory)
    read = read_trajectory(tmp_path / "trajectory.tum")
    np.testing.assert_array_equal(read.timestamps_s, trajectory.timestamps_s)
    np.testing.assert_allclose(read.world_from_vehicle, trajectory.world_from_vehicle, atol=1e-8)
