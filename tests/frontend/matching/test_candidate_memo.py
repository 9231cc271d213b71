"""Memo of match candidates: losses are kept for the pair of frames that they were computed for."""

import numpy as np

from asfm.frontend.matching.candidate_memo import CandidateMemo


def test_losses_are_kept_by_pair_of_frames() -> None:
    memo = CandidateMemo()
    assert np.isnan(memo.ssl_loss((0, 2), 3)).all()
    memo.ssl_loss((0, 2), 3)[1] = 0.25
    assert memo.ssl_loss((0, 2), 3)[1] == 0.25
    assert np.isnan(memo.ssl_loss((1, 2), 3)).all()
