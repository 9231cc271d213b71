"""Files of keypoints and matches: what is read is what was written."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from asfm.study.match_files import read_keypoints, read_matches, write_keypoints, write_matches
from asfm.types import Matches
from tests.worlds import make_frame_pair


def test_keypoints_are_read_as_written_without_patches(tmp_path: Path) -> None:
    pair = make_frame_pair()
    keypoints = [pair.keypoints_a, pair.keypoints_b, pair.keypoints_a]
    write_keypoints(tmp_path / "k.npz", keypoints)
    found = read_keypoints(tmp_path / "k.npz")
    assert len(found) == 3
    for one, other in zip(keypoints, found, strict=True):
        for field in fields(one):
            if field.name != "patches":
                np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name))
                assert getattr(one, field.name).dtype == getattr(other, field.name).dtype
        assert not other.patches.size


@pytest.mark.parametrize("count", [0, 4])
def test_matches_are_read_as_written(tmp_path: Path, count: int) -> None:
    rng = np.random.default_rng(0)
    matches = [
        Matches(a, a + 1, rng.integers(0, 9, (a, 2)), rng.random(a), sigma=rng.random((a, 2)) if a % 2 else None)
        for a in range(count)
    ]
    write_matches(tmp_path / "m.npz", matches)
    found = read_matches(tmp_path / "m.npz")
    assert [(match.frame_a, match.frame_b) for match in found] == [(a, a + 1) for a in range(count)]
    for one, other in zip(matches, found, strict=True):
        np.testing.assert_array_equal(one.index, other.index)
        np.testing.assert_array_equal(one.cost, other.cost)
        assert (one.sigma is None) == (other.sigma is None)
        if one.sigma is not None:
            np.testing.assert_array_equal(one.sigma, other.sigma)
