"""Shared patch alignment: the results of aligning each chain's matches alone."""

import numpy as np
import pytest

from asfm.config import Config
from asfm.frontend.matching.patch_alignment import align_matches
from asfm.frontend.matching.shared_alignment import align_chains
from asfm.types import Matches
from tests.worlds import MATCHING_SONAR, make_frame_pair


@pytest.mark.parametrize("radius_px", [0, 7])
def test_each_chain_is_aligned_as_if_alone(radius_px: int) -> None:
    pair = make_frame_pair()
    keypoints = [pair.keypoints_a, pair.keypoints_b]
    config = Config.model_validate({"localisation": {"radius_px": radius_px, "max_sigma_px": 1.2}})
    choices = [slice(None), slice(0, 20), slice(10, 40, 3), slice(0, 0)]
    chains = [[Matches(0, 1, pair.index[part], np.arange(len(pair.index[part])) / 100)] for part in choices]
    results = align_chains(chains, keypoints, MATCHING_SONAR, config)
    rejected = 0
    for matches, result in zip(chains, results, strict=True):
        (alone,) = align_matches(matches, keypoints, MATCHING_SONAR, config)
        for name in ("index", "cost", "sigma", "rejected", "rejected_by"):
            np.testing.assert_array_equal(getattr(result[0], name), getattr(alone, name), err_msg=name)
        assert result[0].filters == alone.filters
        rejected += len(alone.rejected)
    assert (rejected > 0) == (radius_px > 0), "the test needs matches that are rejected"
