"""Whole simulated sequences: reproducible, lazily rendered, honest about bad requests."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from asfm.errors import AsfmError
from asfm.simulation.simulate import SimulatedSequence, simulate


@pytest.fixture(scope="module")
def tank() -> SimulatedSequence:
    return simulate("tank", frame_count=6, seed=4)


def test_frames_and_truth_have_the_shape_of_the_sonar(tank: SimulatedSequence) -> None:
    sequence = tank.sequence
    assert len(sequence) == 6
    frame, truth = sequence.read_frame(3), tank.read_truth(3)
    assert frame.index == 3 and frame.timestamp_s == pytest.approx(0.6)
    assert frame.image.shape == truth.clean.shape == truth.elevation_rad.shape == sequence.sonar.shape
    assert frame.image.dtype == truth.clean.dtype == np.float32
    assert frame.image.min() >= 0 and frame.image.max() <= 1 and not frame.invalid.any()
    seen = np.isfinite(truth.elevation_rad)
    assert 0.1 < seen.mean() < 0.9
    assert np.abs(truth.elevation_rad[seen]).max() <= sequence.sonar.elevation_aperture_rad / 2 + 1e-3
    # The clean image lies under the truth's support (and the pulse's and beams' smear around it).
    assert truth.clean[seen].mean() > 10 * truth.clean[~seen].mean()


def test_same_seed_same_bytes_in_any_order_on_any_number_of_threads(tank: SimulatedSequence) -> None:
    again = simulate("tank", frame_count=6, seed=4)
    order = [5, 2, 0, 3, 1, 4]
    with ThreadPoolExecutor(2) as pool:
        threaded = dict(zip(order, pool.map(lambda i: again.sequence.read_frame(i).image, order), strict=True))
    for index in range(6):
        assert tank.sequence.read_frame(index).image.tobytes() == threaded[index].tobytes()
    for name in ("groundtruth", "odometry"):
        first, second = getattr(tank.sequence, name), getattr(again.sequence, name)
        assert first.world_from_vehicle.tobytes() == second.world_from_vehicle.tobytes()


def test_another_seed_is_another_world(tank: SimulatedSequence) -> None:
    other = simulate("tank", frame_count=2, seed=5)
    assert not np.array_equal(other.scene.vertices_m, tank.scene.vertices_m)
    assert not np.array_equal(other.sequence.read_frame(0).image, tank.sequence.read_frame(0).image)


def test_noise_differs_from_ping_to_ping(tank: SimulatedSequence) -> None:
    images = [tank.sequence.read_frame(i).image for i in (0, 1)]
    dark = np.logical_and(*(tank.read_truth(i).clean < 1e-3 for i in (0, 1)))
    assert dark.sum() > 10000
    assert abs(np.corrcoef(images[0][dark], images[1][dark])[0, 1]) < 0.05


@pytest.mark.parametrize(
    ("request_", "message"),
    [
        ({"scene_name": "moon"}, "unknown scene 'moon'; known: seafloor, "),
        ({"scene_name": "seafloor", "preset": "lidar"}, "unknown sonar preset 'lidar'; known: "),
        ({"scene_name": "seafloor", "motion": "dance"}, "unknown motion 'dance'; known: "),
        ({"scene_name": "seafloor", "frame_count": 0}, "at least one frame"),
        ({"scene_name": "seafloor", "seed": -1}, "seed of zero or more"),
    ],
)
def test_impossible_requests_name_what_is_known(request_: dict[str, object], message: str) -> None:
    with pytest.raises(AsfmError, match=message):
        simulate(**request_)  # type: ignore[arg-type]
