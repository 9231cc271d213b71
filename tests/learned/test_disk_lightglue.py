"""DISK + LightGlue on simulated images with known motion."""

from asfm.learned.disk_lightglue import match_images
from tests.learned.simulated_pair import check_matcher, check_nothing_to_match, needs_extra


@needs_extra
def test_most_matches_agree_with_the_motion() -> None:
    check_matcher(match_images, with_sonar=True)


@needs_extra
def test_an_image_without_echoes_has_no_matches() -> None:
    check_nothing_to_match(match_images)
