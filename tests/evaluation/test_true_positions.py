"""True positions of keypoints: the elevation at a keypoint, and its projection into another frame."""

from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from asfm.datasets import open_sequence, open_truth
from asfm.evaluation.true_positions import look_up_elevation
from asfm.geometry.poses import interpolate, invert, transform
from asfm.geometry.sonar import back_project, project


def test_elevation_is_that_of_the_nearest_pixel() -> None:
    elevation_rad = np.full((10, 10), np.nan)
    elevation_rad[4, 4], elevation_rad[4, 6] = 0.1, 0.2
    row_column = np.array([[4.5, 4.5], [4.5, 5.4], [4.5, 5.6], [6.4, 4.5], [6.6, 4.5], [0.0, 0.0], [9.99, 9.99]])
    found, known = look_up_elevation(row_column, elevation_rad)
    np.testing.assert_array_equal(known, [True, True, True, True, False, False, False])
    np.testing.assert_array_equal(found, [0.1, 0.1, 0.2, 0.1, 0, 0, 0])
    assert (
        look_up_elevation(row_column, elevation_rad, max_distance_px=0.75)[1].tolist()
        == [True, False, False] + [False] * 4
    )


@given(st.integers(0, 2**32 - 1), st.floats(0.5, 3))
def test_look_up_agrees_with_a_brute_force_search(seed: int, max_distance_px: float) -> None:
    rng = np.random.default_rng(seed)
    elevation_rad = np.where(rng.uniform(size=(8, 6)) < 0.2, rng.normal(size=(8, 6)), np.nan)
    row_column = rng.uniform(0, [8, 6], size=(5, 2))
    found, known = look_up_elevation(row_column, elevation_rad, max_distance_px)
    echoes = np.argwhere(np.isfinite(elevation_rad))
    for place, value, is_known in zip(row_column, found, known, strict=True):
        distance_px = np.linalg.norm(echoes + 0.5 - place, axis=1)
        assert is_known == bool(len(echoes) and distance_px.min() <= max_distance_px)
        if is_known:
            assert value == elevation_rad[tuple(echoes[np.argmin(distance_px)])]


def test_echoes_of_the_simulated_seafloor_project_to_the_elevations_of_a_later_frame(shared_data: Path) -> None:
    """Frames and signs: where an echo of frame a projects to, frame b has the projected elevation."""
    folder = shared_data / "simulated_seafloor"
    sequence, read_truth = open_sequence(folder), open_truth(folder)
    assert sequence.groundtruth is not None
    assert read_truth is not None
    stamps_s = sequence.timestamps_s[[10, 14]]
    poses = interpolate(sequence.groundtruth.timestamps_s, sequence.groundtruth.world_from_vehicle, stamps_s)
    truth_a, truth_b = read_truth(10), read_truth(14)
    strong = np.argwhere(np.isfinite(truth_a.elevation_rad) & (truth_a.clean > 0.3))[::50]
    range_m, bearing_rad = sequence.sonar.range_m[strong[:, 0]], sequence.sonar.bearing_rad[strong[:, 1]]
    elevation_rad, known = look_up_elevation(strong.astype(float) + 0.5, truth_a.elevation_rad)
    assert known.all()
    in_b_m = transform(invert(poses[1]) @ poses[0], back_project(range_m, bearing_rad, elevation_rad))
    range_b_m, bearing_b_rad, expected_rad = project(in_b_m)
    visible = sequence.sonar.sees(in_b_m)
    pixel = np.stack([sequence.sonar.row_at_range(range_b_m), sequence.sonar.column_at_bearing(bearing_b_rad)], axis=1)
    found_rad, known = look_up_elevation(pixel[visible], truth_b.elevation_rad)
    assert visible.sum() > 30
    assert known.mean() > 0.9
    assert np.median(np.abs(found_rad - expected_rad[visible])[known]) < np.radians(0.5)
