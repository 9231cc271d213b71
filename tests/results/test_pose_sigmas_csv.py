"""pose_sigmas.csv: standard deviations of every pose."""

from pathlib import Path

import numpy as np
import pytest

from asfm.results.pose_sigmas_csv import write_pose_sigmas


def test_pose_sigmas_are_the_square_roots_of_the_diagonals(tmp_path: Path) -> None:
    sigma = np.random.default_rng(3).uniform(0.001, 0.1, (4, 6))
    covariance = sigma[:, :, None] * np.eye(6) * sigma[:, None] + 1e-9
    write_pose_sigmas(tmp_path / "pose_sigmas.csv", np.array([0.5, 1.0, 1.5, 2.25]), covariance)
    header, *rows = (tmp_path / "pose_sigmas.csv").read_text().splitlines()
    assert header == "timestamp_s,roll_rad,pitch_rad,yaw_rad,forward_m,port_m,up_m"
    read = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    np.testing.assert_array_equal(read[:, 0], [0.5, 1.0, 1.5, 2.25])
    np.testing.assert_allclose(read[:, 1:], sigma, rtol=1e-3)
    with pytest.raises(ValueError, match="pose sigmas"):
        write_pose_sigmas(tmp_path / "pose_sigmas.csv", np.arange(4.0), np.full((4, 6, 6), np.nan))
