"""Structural-and-spatial loss against scikit-image and plain loops."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from skimage.metrics import structural_similarity

from asfm.config import SslConfig
from asfm.errors import AsfmError
from asfm.frontend.matching.ssl import Patches, compare_stretched, stretch_patches, structural_spatial_loss

BOTH = SslConfig(structural_weight=1, spatial_weight=1)


@pytest.fixture(params=[3, 7, 10])
def pairs(request: pytest.FixtureRequest) -> tuple[Patches, Patches]:
    """Patches from unrelated to equal, some of them flat, binary or of low contrast."""
    rng = np.random.default_rng(request.param)
    width = 2 * request.param + 1
    a = rng.random((60, width, width)).astype(np.float32)
    mix = np.linspace(0, 1, 60, dtype=np.float32)[:, None, None]
    b = (mix * a + (1 - mix) * rng.random(a.shape).astype(np.float32)).astype(np.float32)
    a[3], b[5], a[7], b[7] = 0, 1, 0.25, 0.25
    a[11], b[13] = a[11] > 0.5, b[13] > 0.9
    a[17], a[19] = 1e-4 * a[17], 0.5 + 1e-5 * a[19]
    return a, b


def test_structural_term_equals_that_of_scikit_image(pairs: tuple[Patches, Patches]) -> None:
    stretched = (stretch_patches(patches).astype(float) for patches in pairs)
    expected = [(1 - structural_similarity(a, b, data_range=1.0)) / 2 for a, b in zip(*stretched, strict=True)]
    loss = structural_spatial_loss(*pairs, SslConfig(structural_weight=1, spatial_weight=0))
    np.testing.assert_allclose(loss, expected, atol=2e-7)


def test_spatial_term_equals_that_of_plain_loops(pairs: tuple[Patches, Patches]) -> None:
    def describe(patch: Patches) -> list[float]:
        return [*(float(c.mean()) for c in patch.T), *(float(r.mean()) for r in patch), float(patch.mean())]

    loss = structural_spatial_loss(*pairs, SslConfig(structural_weight=0, spatial_weight=1))
    stretched = (stretch_patches(patches).astype(float) for patches in pairs)
    for a, b, term in zip(*stretched, loss, strict=True):
        u, v = describe(a), describe(b)
        distance = sum((p - q) ** 2 for p, q in zip(u, v, strict=True)) ** 0.5
        assert term == pytest.approx(distance / len(u) ** 0.5, abs=1e-6)


def test_stretched_patches_range_from_0_to_1(pairs: tuple[Patches, Patches]) -> None:
    for patches in pairs:
        exact = patches.astype(float)
        low, high = exact.min(axis=(1, 2)), exact.max(axis=(1, 2))
        expected = (exact - low[:, None, None]) / np.where(high > low, high - low, 1)[:, None, None]
        stretched = stretch_patches(patches)
        np.testing.assert_allclose(stretched, expected, atol=2e-7)
        assert set(np.unique(stretched.max(axis=(1, 2))).tolist()) <= {0.0, 1.0}
        assert not stretched.min(axis=(1, 2)).any()


def test_loss_is_the_weighted_sum_of_its_terms(pairs: tuple[Patches, Patches]) -> None:
    structural = structural_spatial_loss(*pairs, SslConfig(structural_weight=1, spatial_weight=0))
    spatial = structural_spatial_loss(*pairs, SslConfig(structural_weight=0, spatial_weight=1))
    assert (structural != spatial).any()
    for weights in [(1.0, 1.0), (0.3, 2.0), (0.0, 0.0)]:
        config = SslConfig(structural_weight=weights[0], spatial_weight=weights[1])
        expected = weights[0] * structural + weights[1] * spatial
        np.testing.assert_allclose(structural_spatial_loss(*pairs, config), expected, atol=1e-12)


def test_loss_is_zero_for_patches_that_differ_in_gain_and_offset(pairs: tuple[Patches, Patches]) -> None:
    a = pairs[0].astype(float)
    loss = structural_spatial_loss(a, 3.0 * a + 0.5, BOTH)
    np.testing.assert_allclose(loss, 0.0, atol=1e-7)


def test_loss_is_symmetric_bounded_and_sensitive_to_shift_and_transposition(pairs: tuple[Patches, Patches]) -> None:
    a, b = pairs
    loss = structural_spatial_loss(a, b, BOTH)
    np.testing.assert_allclose(loss, structural_spatial_loss(b, a, BOTH), atol=1e-12)
    assert (loss >= 0).all()
    assert (loss <= 2).all()
    patch = np.zeros((2, 15, 15), dtype=np.float32)
    patch[0, 3:6, 7:9] = 1
    patch[1, 9:12, 4:6] = 1
    moved = structural_spatial_loss(patch[:1], patch[1:], BOTH)
    turned = structural_spatial_loss(patch[:1], patch[:1].transpose(0, 2, 1), BOTH)
    assert moved[0] > 0.1
    assert turned[0] > 0.1


def test_losses_of_a_batch_equal_those_of_single_pairs() -> None:
    rng = np.random.default_rng(4)
    a, b = rng.random((2, 300, 15, 15)).astype(np.float32)
    loss = structural_spatial_loss(a, b, BOTH)
    alone = [structural_spatial_loss(a[i : i + 1], b[i : i + 1], BOTH)[0] for i in range(300)]
    np.testing.assert_allclose(loss, alone, atol=1e-7)


@pytest.mark.parametrize("width", [1, 3, 5])
def test_patches_smaller_than_the_window_have_a_finite_loss(width: int) -> None:
    rng = np.random.default_rng(0)
    a, b = rng.random((2, 8, width, width))
    assert np.isfinite(structural_spatial_loss(a, b, BOTH)).all()


def test_patches_stretched_beforehand_have_the_same_loss(pairs: tuple[Patches, Patches]) -> None:
    a, b = pairs
    for config in (BOTH, SslConfig(structural_weight=0), SslConfig(spatial_weight=0)):
        once = compare_stretched(stretch_patches(a), stretch_patches(b), config)
        np.testing.assert_allclose(once, structural_spatial_loss(a, b, config), atol=2e-7)


def test_a_term_of_weight_zero_is_not_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("a term of weight zero was computed")

    a = np.random.default_rng(0).random((4, 15, 15)).astype(np.float32)
    for term, config in (("structural", SslConfig(structural_weight=0)), ("spatial", SslConfig(spatial_weight=0))):
        with monkeypatch.context() as patch:
            patch.setattr(f"asfm.frontend.matching.ssl._{term}_term", refuse)
            assert not structural_spatial_loss(a, a, config).any()
            with pytest.raises(AssertionError):
                structural_spatial_loss(a, a, BOTH)


@pytest.mark.parametrize("dtype", [np.float64, np.uint8, np.uint16])
def test_patches_of_another_type_have_the_same_loss(dtype: type) -> None:
    counts = np.random.default_rng(0).integers(0, 256, (2, 9, 15, 15))
    expected, found = (
        structural_spatial_loss(counts[0].astype(kind), counts[1].astype(kind), BOTH) for kind in (np.float32, dtype)
    )
    np.testing.assert_allclose(found, expected, atol=1e-7)


def test_threads_do_not_share_buffers() -> None:
    a, b = np.random.default_rng(5).random((2, 600, 15, 15)).astype(np.float32)
    expected = structural_spatial_loss(a, b, BOTH)
    with ThreadPoolExecutor(4) as pool:
        for loss in pool.map(lambda _: structural_spatial_loss(a, b, BOTH), range(12)):
            np.testing.assert_array_equal(loss, expected)


def test_no_matches_have_no_losses() -> None:
    none = np.zeros((0, 15, 15), dtype=np.float32)
    assert structural_spatial_loss(none, none, BOTH).shape == (0,)


def test_bad_patches_are_errors_that_name_frame_and_patch() -> None:
    good = np.zeros((4, 15, 15), dtype=np.float32)
    for value in (np.nan, np.inf, -np.inf, 1e300):
        bad = good.astype(float)
        bad[2, 0, 14] = value
        for terms in ((1, 1), (1, 0), (0, 1), (0, 0)):
            config = SslConfig(structural_weight=terms[0], spatial_weight=terms[1])
            with pytest.raises(AsfmError, match="patch 2 of the second frame"):
                structural_spatial_loss(good, bad, config)
            if value != 1e300:
                with pytest.raises(AsfmError, match="patch 2 of the first frame"):
                    structural_spatial_loss(bad.astype(np.float32), good, config)
    with pytest.raises(AsfmError, match=r"\(3, 15, 15\)"):
        structural_spatial_loss(good, good[:3], BOTH)
    with pytest.raises(AsfmError, match="square patches"):
        structural_spatial_loss(good[:, :14], good[:, :14], BOTH)
