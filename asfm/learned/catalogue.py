"""Catalogue of learned matchers: functions of two sonar images by name."""

from collections.abc import Callable

from asfm.errors import AsfmError, quote
from asfm.learned import aliked_lightglue, disk_lightglue, xfeat
from asfm.learned.weights import check_extra
from asfm.types import FloatArray, IntArray

MatchImages = Callable[..., tuple[FloatArray, FloatArray, IntArray]]
"""Signature of :func:`asfm.learned.aliked_lightglue.match_images`."""
LEARNED_MATCHERS: dict[str, MatchImages] = {
    "aliked_lightglue": aliked_lightglue.match_images,
    "disk_lightglue": disk_lightglue.match_images,
    "xfeat": xfeat.match_images,
}
"""They can be called without the extra ``learned`` being installed, and then say how to install it."""


def find_learned_matcher(name: str) -> MatchImages:
    """Return a learned matcher by its name.

    Raises:
        AsfmError: the name is unknown, or the extra ``learned`` is not installed.
    """
    if name not in LEARNED_MATCHERS:
        raise AsfmError(f"expected a learned matcher ({', '.join(LEARNED_MATCHERS)}), found {quote(name)}")
    check_extra()
    return LEARNED_MATCHERS[name]
