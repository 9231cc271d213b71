"""Alignment finds shifts of known images to a fraction of a pixel, says how surely, and rejects what unlocalised."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from asfm.config import Config, LocalisationConfig
from asfm.frontend.features.patches import cut_patches
from asfm.frontend.matching.patch_alignment import align_matches, align_patches
from asfm.geometry.sonar import SonarModel
from asfm.types import FloatArray, ImageArray, Keypoints, Matches

SIDE_PX = 200
SONAR = SonarModel.evenly_spaced("test", (1.0, 11.0), (-0.5, 0.5), (SIDE_PX, SIDE_PX), 0.3)


def make_texture(seed: int, blur_px: float = 2.0) -> ImageArray:
    """A smooth random image in 0..1."""
    noise = gaussian_filter(np.random.default_rng(seed).normal(size=(SIDE_PX, SIDE_PX)), blur_px)
    return np.asarray((noise - noise.min()) / np.ptp(noise), dtype=np.float32)


def move(image: ImageArray, shift_px: FloatArray) -> ImageArray:
    """The same things, further along rows and columns: an oracle made by SciPy's splines."""
    place = np.indices(image.shape) - shift_px.reshape(2, 1, 1)
    return np.asarray(map_coordinates(image, place, order=3, mode="nearest"), dtype=np.float32)


def cut(image: ImageArray, places: FloatArray) -> ImageArray:
    return cut_patches(image, places, 10)


def make_places(count: int = 60, seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).uniform(30, SIDE_PX - 30, (count, 2))


@pytest.mark.parametrize("shift_px", [(0.0, 0.0), (0.4, -0.3), (-0.6, 0.7), (1.0, 0.2)])
def test_a_known_shift_is_found(shift_px: tuple[float, float]) -> None:
    image, places = make_texture(0, blur_px=3.0), make_places()
    moved = move(image, np.array(shift_px))
    found, covariance = align_patches(cut(image, places), cut(moved, places), 50.0)
    error = found - shift_px
    assert np.abs(np.median(error, axis=0)).max() < 0.05
    assert np.quantile(np.abs(error), 0.9) < 0.25
    assert (np.linalg.eigvalsh(covariance) >= 0).all()


def test_gain_and_offset_do_not_matter() -> None:
    image, places = make_texture(1), make_places()
    a, b = cut(image, places), cut(move(image, np.array([0.5, 0.5])), places)
    plain, _ = align_patches(a, b, 50.0)
    changed, _ = align_patches(a, np.float32(0.3) * b + np.float32(0.2), 50.0)
    np.testing.assert_allclose(changed, plain, atol=1e-3)


def test_the_stated_sigma_follows_the_noise() -> None:
    """Noise as smooth as the image's own: the errors are what is stated, within a factor of two."""
    image, places = make_texture(2, blur_px=4.0), make_places(300)
    errors, stated = [], []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        noisy = [image + 0.03 * gaussian_filter(rng.normal(size=image.shape), 2.0) / 0.14 for _ in range(2)]
        shift, covariance = align_patches(cut(noisy[0], places), cut(noisy[1], places), 16 * np.pi)
        errors.append(shift)
        stated.append(covariance)
    whitened = np.einsum(
        "mi,mij,mj->m", np.concatenate(errors), np.linalg.inv(np.concatenate(stated)), np.concatenate(errors)
    )
    assert 0.25 < np.median(whitened) / 1.386 < 4  # median of a chi-square of two degrees of freedom


def test_an_edge_leaves_its_own_direction_open() -> None:
    image = np.tile((np.arange(SIDE_PX) > SIDE_PX / 2).astype(np.float32)[:, None], (1, SIDE_PX))
    image = gaussian_filter(image, 2.0) + 0.02 * make_texture(3)
    places = np.stack([np.full(20, SIDE_PX / 2), np.linspace(40, 160, 20)], axis=1)
    noisy = image + 0.02 * make_texture(4)
    _, covariance = align_patches(cut(image, places), cut(noisy.astype(np.float32), places), 50.0)
    across, along = np.sqrt(covariance[:, 0, 0]), np.sqrt(covariance[:, 1, 1])
    assert (along > 5 * across).all()


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_flat_patches_stay_where_they_are_and_are_unsure(value: float) -> None:
    patches = np.full((4, 21, 21), value, dtype=np.float32)
    textured = cut(make_texture(5), make_places(4))
    for a, b in ((patches, patches), (patches, textured), (textured, patches)):
        shift, covariance = align_patches(a, b, 50.0)
        assert np.isfinite(shift).all() and np.isfinite(covariance).all()
    assert align_patches(patches, patches, 50.0)[0].tolist() == np.zeros((4, 2)).tolist()


def test_nothing_to_align_gives_nothing() -> None:
    nothing = np.zeros((0, 21, 21), dtype=np.float32)
    shift, covariance = align_patches(nothing, nothing, 50.0)
    assert shift.shape == (0, 2) and covariance.shape == (0, 2, 2)


def make_keypoints(image: ImageArray, places: FloatArray) -> Keypoints:
    return Keypoints(
        places,
        SONAR.range_at_row(places[:, 0]),
        SONAR.bearing_at_column(places[:, 1]),
        np.ones(len(places)),
        np.zeros((len(places), 61), dtype=np.uint8),
        cut(image, places),
    )


def make_match(count: int) -> Matches:
    return Matches(0, 1, np.stack([np.arange(count)] * 2, axis=1), np.linspace(0, 1, count))


def stay_polar(max_sigma_px: float = 8.0, radius_px: int = 10) -> Config:
    """Pixels of the picture are those of the polar image."""
    config = Config(localisation=LocalisationConfig(max_sigma_px=max_sigma_px, radius_px=radius_px))
    return config.model_copy(update={"keypoints": config.keypoints.model_copy(update={"max_stretch": 1.0})})


def test_sigmas_of_well_localised_matches_cover_the_jitter_of_the_detector() -> None:
    """The stated sigma is that of the detector's position, from which the patches' shift leaves hardly any doubt."""
    image, places = make_texture(6), make_places()
    moved = move(image, np.array([3.3, -2.6]))
    jitter = np.random.default_rng(1).normal(0, 0.7, places.shape)
    keypoints = [make_keypoints(image, places), make_keypoints(moved, places + np.array([3.3, -2.6]) + jitter)]
    (match,) = align_matches([make_match(len(places))], keypoints, SONAR, stay_polar())
    assert match.sigma is not None and len(match) > 0.9 * len(places)
    of_a, of_b = match.index.T
    true = np.stack([SONAR.range_at_row(places[of_a, 0] + 3.3), SONAR.bearing_at_column(places[of_a, 1] - 2.6)], axis=1)
    error = (keypoints[1].range_bearing[of_b] - true) / match.sigma
    assert (error.std(axis=0) > 0.5).all() and (error.std(axis=0) < 1.3).all()
    assert (match.sigma[:, 0] >= 0.69 * SONAR.range_step_m).all()  # floor_px


def test_matches_along_an_edge_are_rejected_as_unlocalised() -> None:
    stripes = np.sin(np.arange(SIDE_PX) / 3.0).astype(np.float32)[:, None] * np.ones(SIDE_PX, dtype=np.float32)
    places = make_places()
    noisy = [stripes + np.float32(0.1) * make_texture(seed) for seed in (7, 8)]
    keypoints = [make_keypoints(image, places) for image in noisy]
    (strict,) = align_matches([make_match(len(places))], keypoints, SONAR, stay_polar(max_sigma_px=1.0))
    assert len(strict) < 0.2 * len(places)
    assert strict.count_rejected() == {"unlocalised": len(places) - len(strict)}
    assert strict.sigma is not None and len(strict.sigma) == len(strict)


def test_without_patches_matches_stay_as_they_are() -> None:
    keypoints = [make_keypoints(make_texture(9), make_places(5))] * 2
    (match,) = align_matches([make_match(5)], keypoints, SONAR, stay_polar(radius_px=0))
    assert match.sigma is None and len(match) == 5


def test_pairs_without_matches_are_kept_in_their_place() -> None:
    keypoints = [make_keypoints(make_texture(10), make_places(5))] * 2
    matches = align_matches([make_match(0), make_match(5)], keypoints, SONAR, stay_polar(max_sigma_px=100.0))
    assert [len(match) for match in matches] == [0, 5]
