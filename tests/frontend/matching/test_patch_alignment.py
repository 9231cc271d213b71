"""Patch alignment: subpixel shifts of known images, their stated covariance, and rejection of unlocalised matches."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from asfm.config import Config, LocalisationConfig
from asfm.frontend.features.patches import cut_patches
from asfm.frontend.matching.patch_alignment import align_matches, align_patches
from asfm.geometry.sonar import SonarModel
from asfm.types import FloatArray, ImageArray, Keypoints, Matches
from tests.worlds import make_keypoints

SIDE_PX = 200
SONAR = SonarModel.evenly_spaced("test", (1.0, 11.0), (-0.5, 0.5), (SIDE_PX, SIDE_PX), 0.3)


def make_texture(seed: int, blur_px: float = 2.0) -> ImageArray:
    """Return a smooth random image in 0..1."""
    noise = gaussian_filter(np.random.default_rng(seed).normal(size=(SIDE_PX, SIDE_PX)), blur_px)
    return np.asarray((noise - noise.min()) / np.ptp(noise), dtype=np.float32)


def move(image: ImageArray, shift_px: FloatArray) -> ImageArray:
    """Shift an image along rows and columns by SciPy's spline interpolation."""
    position = np.indices(image.shape) - shift_px.reshape(2, 1, 1)
    return np.asarray(map_coordinates(image, position, order=3, mode="nearest"), dtype=np.float32)


def cut(image: ImageArray, positions: FloatArray) -> ImageArray:
    return cut_patches(image, positions, 10)


def make_positions(count: int = 60, seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).uniform(30, SIDE_PX - 30, (count, 2))


@pytest.mark.parametrize("shift_px", [(0.0, 0.0), (0.4, -0.3), (-0.6, 0.7), (1.0, 0.2)])
def test_a_known_shift_is_estimated(shift_px: tuple[float, float]) -> None:
    image, positions = make_texture(0, blur_px=3.0), make_positions()
    moved = move(image, np.array(shift_px))
    found, covariance = align_patches(cut(image, positions), cut(moved, positions), 50.0)
    error = found - shift_px
    assert np.abs(np.median(error, axis=0)).max() < 0.05
    assert np.quantile(np.abs(error), 0.9) < 0.25
    assert (np.linalg.eigvalsh(covariance) >= 0).all()


def test_gain_and_offset_do_not_matter() -> None:
    image, positions = make_texture(1), make_positions()
    a, b = cut(image, positions), cut(move(image, np.array([0.5, 0.5])), positions)
    plain, _ = align_patches(a, b, 50.0)
    changed, _ = align_patches(a, np.float32(0.3) * b + np.float32(0.2), 50.0)
    np.testing.assert_allclose(changed, plain, atol=1e-3)


def test_the_stated_covariance_is_that_of_the_errors() -> None:
    """Noise as smooth as the image: whitened errors follow the chi-square distribution, within a factor of four."""
    image, positions = make_texture(2, blur_px=4.0), make_positions(300)
    errors, stated = [], []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        noisy = [image + 0.03 * gaussian_filter(rng.normal(size=image.shape), 2.0) / 0.14 for _ in range(2)]
        shift, covariance = align_patches(cut(noisy[0], positions), cut(noisy[1], positions), 16 * np.pi)
        errors.append(shift)
        stated.append(covariance)
    whitened = np.einsum(
        "mi,mij,mj->m", np.concatenate(errors), np.linalg.inv(np.concatenate(stated)), np.concatenate(errors)
    )
    assert 0.25 < np.median(whitened) / 1.386 < 4  # median of a chi-square of two degrees of freedom


def test_the_shift_along_an_edge_is_uncertain() -> None:
    image = np.tile((np.arange(SIDE_PX) > SIDE_PX / 2).astype(np.float32)[:, None], (1, SIDE_PX))
    image = gaussian_filter(image, 2.0) + 0.02 * make_texture(3)
    positions = np.stack([np.full(20, SIDE_PX / 2), np.linspace(40, 160, 20)], axis=1)
    noisy = image + 0.02 * make_texture(4)
    _, covariance = align_patches(cut(image, positions), cut(noisy.astype(np.float32), positions), 50.0)
    across, along = np.sqrt(covariance[:, 0, 0]), np.sqrt(covariance[:, 1, 1])
    assert (along > 5 * across).all()


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_flat_patches_give_finite_results_and_no_shift(value: float) -> None:
    patches = np.full((4, 21, 21), value, dtype=np.float32)
    textured = cut(make_texture(5), make_positions(4))
    for a, b in ((patches, patches), (patches, textured), (textured, patches)):
        shift, covariance = align_patches(a, b, 50.0)
        assert np.isfinite(shift).all() and np.isfinite(covariance).all()
    assert align_patches(patches, patches, 50.0)[0].tolist() == np.zeros((4, 2)).tolist()


def test_no_patches_give_empty_results() -> None:
    nothing = np.zeros((0, 21, 21), dtype=np.float32)
    shift, covariance = align_patches(nothing, nothing, 50.0)
    assert shift.shape == (0, 2) and covariance.shape == (0, 2, 2)


def keypoints_at(image: ImageArray, row_column: FloatArray) -> Keypoints:
    range_m, bearing_rad = SONAR.range_at_row(row_column[:, 0]), SONAR.bearing_at_column(row_column[:, 1])
    return make_keypoints(range_m, bearing_rad, patches=cut(image, row_column), sonar=SONAR)


def make_match(count: int) -> Matches:
    return Matches(0, 1, np.stack([np.arange(count)] * 2, axis=1), np.linspace(0, 1, count))


def unwarped_config(max_sigma_px: float = 8.0, radius_px: int = 10) -> Config:
    """Return settings under which the pixels of the warped image are those of the polar image."""
    config = Config(localisation=LocalisationConfig(max_sigma_px=max_sigma_px, radius_px=radius_px))
    return config.model_copy(update={"keypoints": config.keypoints.model_copy(update={"max_stretch": 1.0})})


def test_stated_sigmas_cover_the_jitter_of_the_detector() -> None:
    """Keypoints of frame b are jittered around true positions: their normalised errors have a spread near 1."""
    image, positions = make_texture(6), make_positions()
    moved = move(image, np.array([3.3, -2.6]))
    jitter = np.random.default_rng(1).normal(0, 0.7, positions.shape)
    keypoints = [keypoints_at(image, positions), keypoints_at(moved, positions + np.array([3.3, -2.6]) + jitter)]
    (match,) = align_matches([make_match(len(positions))], keypoints, SONAR, unwarped_config())
    assert match.sigma is not None and len(match) > 0.9 * len(positions)
    of_a, of_b = match.index.T
    true = np.stack(
        [SONAR.range_at_row(positions[of_a, 0] + 3.3), SONAR.bearing_at_column(positions[of_a, 1] - 2.6)], axis=1
    )
    error = (keypoints[1].range_bearing[of_b] - true) / match.sigma
    assert (error.std(axis=0) > 0.5).all() and (error.std(axis=0) < 1.3).all()
    assert (match.sigma[:, 0] >= 0.69 * SONAR.range_step_m).all()  # floor_px


def test_matches_along_an_edge_are_rejected_as_unlocalised() -> None:
    stripes = np.sin(np.arange(SIDE_PX) / 3.0).astype(np.float32)[:, None] * np.ones(SIDE_PX, dtype=np.float32)
    positions = make_positions()
    noisy = [stripes + np.float32(0.1) * make_texture(seed) for seed in (7, 8)]
    keypoints = [keypoints_at(image, positions) for image in noisy]
    (strict,) = align_matches([make_match(len(positions))], keypoints, SONAR, unwarped_config(max_sigma_px=1.0))
    assert len(strict) < 0.2 * len(positions)
    assert strict.count_rejected() == {"unlocalised": len(positions) - len(strict)}
    assert strict.sigma is not None and len(strict.sigma) == len(strict)


def test_radius_zero_leaves_matches_unchanged() -> None:
    keypoints = [keypoints_at(make_texture(9), make_positions(5))] * 2
    (match,) = align_matches([make_match(5)], keypoints, SONAR, unwarped_config(radius_px=0))
    assert match.sigma is None and len(match) == 5


def test_pairs_without_matches_keep_their_position() -> None:
    keypoints = [keypoints_at(make_texture(10), make_positions(5))] * 2
    matches = align_matches([make_match(0), make_match(5)], keypoints, SONAR, unwarped_config(max_sigma_px=100.0))
    assert [len(match) for match in matches] == [0, 5]


def sigma_px(match: Matches) -> FloatArray:
    """Return the (M, 2) sigmas in rows and columns of the image, which is not stretched."""
    assert match.sigma is not None
    return np.asarray(match.sigma / [SONAR.range_step_m, SONAR.bearing_step_rad])


@pytest.mark.parametrize("axis", [0, 1])
def test_an_edge_is_uncertain_in_range_or_bearing_whichever_runs_along_it(axis: int) -> None:
    stripes = np.sin(np.arange(SIDE_PX) / 3.0).astype(np.float32)[:, None] * np.ones(SIDE_PX, dtype=np.float32)
    edge = stripes if axis == 1 else stripes.T
    keypoints = [keypoints_at(edge + np.float32(0.1) * make_texture(seed), make_positions()) for seed in (7, 8)]
    (match,) = align_matches([make_match(60)], keypoints, SONAR, unwarped_config(max_sigma_px=1e3))
    found = np.median(sigma_px(match), axis=0)
    assert found[axis] > 1.5 * found[1 - axis]


def test_sigmas_are_the_scaled_ones_of_the_alignment_and_the_floor_in_quadrature() -> None:
    image, positions = make_texture(11), make_positions()
    keypoints = [keypoints_at(image + np.float32(0.05) * make_texture(seed), positions) for seed in (12, 13)]

    def align(scale: float, floor_px: float) -> FloatArray:
        localisation = LocalisationConfig(sigma_scale=scale, floor_px=floor_px, max_sigma_px=1e3, radius_px=10)
        config = unwarped_config().model_copy(update={"localisation": localisation})
        (match,) = align_matches([make_match(60)], keypoints, SONAR, config)
        return sigma_px(match)

    aligned = align(1.0, 1e-6)
    np.testing.assert_allclose(align(1e-6, 0.3), 0.3, rtol=1e-3)
    np.testing.assert_allclose(align(3.0, 1e-6), 3 * aligned, rtol=1e-3)
    np.testing.assert_allclose(align(3.0, 0.3), np.hypot(3 * aligned, 0.3), rtol=1e-3)


@pytest.mark.parametrize(("shift_px", "least", "most"), [(1.0, 0.95, 1.0), (6.0, 0.0, 0.5)])
def test_matches_whose_patches_lie_far_apart_are_rejected(shift_px: float, least: float, most: float) -> None:
    """However small the stated sigma: the linearisation is not valid so far away."""
    image, positions = make_texture(14, blur_px=8.0), make_positions()
    moved = move(image, np.array([0.0, shift_px]))
    keypoints = [keypoints_at(image, positions), keypoints_at(moved, positions)]
    (match,) = align_matches([make_match(60)], keypoints, SONAR, unwarped_config(max_sigma_px=1e3))
    assert least <= len(match) / 60 <= most


def test_shift_and_covariance_are_those_of_linear_least_squares() -> None:
    """One pair of patches at a time, with the mean of both gradients and the variance of what is left."""
    image, positions = make_texture(15), make_positions(12)
    a, b = cut(image, positions), cut(move(image, np.array([0.4, -0.2])) + 0.05 * make_texture(16), positions)
    found, covariance = align_patches(a, b, 40.0)
    for index in range(12):
        one, two = ((patch - patch.mean()) / patch.std() for patch in (a[index].astype(float), b[index].astype(float)))
        rows, columns = np.gradient((one + two) / 2)
        gradient = np.stack([part[1:-1, 1:-1].ravel() for part in (rows, columns)], axis=1)
        difference = (one - two)[1:-1, 1:-1].ravel()
        shift, residual, _, _ = np.linalg.lstsq(gradient, difference, rcond=None)
        variance = 40.0 * residual[0] / len(difference)
        np.testing.assert_allclose(found[index], shift, atol=1e-3)
        np.testing.assert_allclose(covariance[index], variance * np.linalg.inv(gradient.T @ gradient), rtol=1e-2)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("side", [-1, 1])
def test_the_distance_of_keypoints_includes_their_place_in_the_pixel(axis: int, sign: int, side: int) -> None:
    """Patches are cut about whole pixels: 3 px between them are 2.1 or 3.9 px between the keypoints, of at most 3."""
    image, step = make_texture(14, blur_px=8.0), sign * np.eye(2)[axis]
    positions = np.floor(make_positions()) + 0.5
    keypoints = [
        keypoints_at(image, positions - side * 0.45 * step),
        keypoints_at(move(image, 3.0 * step), positions + side * 0.45 * step),
    ]
    (match,) = align_matches([make_match(60)], keypoints, SONAR, unwarped_config(max_sigma_px=1e3))
    assert len(match) > 0.9 * 60 if side > 0 else len(match) < 0.6 * 60
