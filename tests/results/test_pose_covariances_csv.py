"""pose_covariances.csv: full covariances read back, and damage is a one-line error."""

from pathlib import Path

import numpy as np
import pytest

from asfm.errors import AsfmError
from asfm.results.pose_covariances_csv import read_pose_covariances, write_pose_covariances


def test_covariances_are_read_back(tmp_path: Path) -> None:
    factor = np.random.default_rng(0).normal(0, 0.1, (5, 6, 6))
    covariance, path = factor @ np.swapaxes(factor, 1, 2), tmp_path / "pose_covariances.csv"
    write_pose_covariances(path, np.arange(5.0), covariance)
    np.testing.assert_allclose(read_pose_covariances(path, 5), covariance, rtol=1e-8)
    lines = path.read_text().splitlines()
    assert lines[0].startswith("timestamp_s,roll_roll,roll_pitch,") and lines[0].endswith(",up_up")
    with pytest.raises(AsfmError, match="expected a row for each of 6 frames, found 5"):
        read_pose_covariances(path, 6)
    path.write_text("\n".join([lines[0], lines[1].replace("e-0", "x", 1), *lines[2:]]))
    with pytest.raises(AsfmError, match=r"^[^\n]*line 2: expected a number[^\n]*$"):
        read_pose_covariances(path, 5)
    with pytest.raises(ValueError, match="pose covariances"):
        write_pose_covariances(path, np.arange(5.0), np.full((5, 6, 6), np.nan))
