"""Configuration: immutable, validated windows, and patches as large as any stage needs."""

import pytest
from pydantic import ValidationError

from asfm.config import CfarConfig, Config, LocalisationConfig, MatchingConfig, SslConfig


def test_configuration_is_frozen() -> None:
    with pytest.raises(ValidationError, match="frozen"):
        Config().seed = 3


def test_window_along_ranges_only_is_valid() -> None:
    assert CfarConfig(guard_px=(4, 0), reference_px=(16, 0)).reference_px == (16, 0)


@pytest.mark.parametrize(
    ("guard_px", "reference_px"), [((4, 4), (4, 4)), ((5, 4), (4, 6)), ((4, 7), (6, 6)), ((-1, 0), (4, 4))]
)
def test_a_guard_window_that_is_not_inside_the_reference_window_is_an_error(
    guard_px: tuple[int, int], reference_px: tuple[int, int]
) -> None:
    with pytest.raises(ValidationError, match="expected 0 <= guard_px <= reference_px"):
        CfarConfig(guard_px=guard_px, reference_px=reference_px)


def test_each_filter_is_listed_once() -> None:
    with pytest.raises(ValidationError, match="at most once"):
        MatchingConfig(filters=("mutual", "ratio", "mutual"))


@pytest.mark.parametrize(("ssl_px", "alignment_px"), [(3, 9), (9, 3), (5, 0)])
def test_patches_are_as_large_as_the_larger_of_their_uses(ssl_px: int, alignment_px: int) -> None:
    config = Config(ssl=SslConfig(radius_px=ssl_px), localisation=LocalisationConfig(radius_px=alignment_px))
    assert config.patch_radius_px == max(ssl_px, alignment_px)


def test_a_long_list_of_filters_is_quoted_shortly() -> None:
    with pytest.raises(ValidationError) as caught:
        MatchingConfig(filters=("arc",) * 500)
    assert caught.value.errors()[0]["msg"].count("arc") < 20
