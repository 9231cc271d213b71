"""Memo of match candidates: what several filter chains over the same keypoints need, computed once."""

from dataclasses import dataclass, field

import numpy as np

from asfm.frontend.matching.nearest import NearestNeighbours
from asfm.types import FloatArray


@dataclass
class CandidateMemo:
    """Nearest neighbours and losses of frame pairs, by the frames' indices (a, b)."""

    nearest: dict[tuple[int, int], NearestNeighbours] = field(default_factory=dict)
    """Among all keypoints of frame b."""
    _ssl_loss: dict[tuple[int, int], FloatArray] = field(default_factory=dict)

    def ssl_loss(self, frames: tuple[int, int], count: int) -> FloatArray:
        """Return the losses (Ka,) of the matches of frame a's ``count`` keypoints, NaN where not yet computed."""
        return self._ssl_loss.setdefault(frames, np.full(count, np.nan))
