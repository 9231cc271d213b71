"""Simulated sequences: reproducible in any order, rendered when read, invalid requests refused."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.errors import AsfmError
from asfm.geometry.poses import make_pose
from asfm.simulation.simulate import SimulatedSequence, add_sensors, simulate
from asfm.types import Trajectory


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
    # The clean image is bright where the truth has an elevation, and dark elsewhere but for the point spread.
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


def test_another_seed_gives_another_scene_and_noise(tank: SimulatedSequence) -> None:
    other = simulate("tank", frame_count=2, seed=5)
    assert not np.array_equal(other.scene.vertices_m, tank.scene.vertices_m)
    assert not np.array_equal(other.sequence.read_frame(0).image, tank.sequence.read_frame(0).image)


def test_noise_of_two_pings_is_uncorrelated(tank: SimulatedSequence) -> None:
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
def test_invalid_requests_name_the_known_values(request_: dict[str, object], message: str) -> None:
    with pytest.raises(AsfmError, match=message):
        simulate(**request_)  # type: ignore[arg-type]


def test_given_path_is_sampled_at_the_sonars_rate_until_it_ends() -> None:
    angle = Rotation.from_euler("ZYX", [0.1, -0.5, 0.0])
    ends = make_pose(np.array([[-4.0, 0, -2.0], [-2.0, 0, -2.0]]), Rotation.concatenate([angle, angle]))
    simulated = simulate("hull", motion=Trajectory(np.array([10.0, 14.0]), ends), frame_count=80)
    truth = simulated.sequence.groundtruth
    assert truth is not None
    assert len(simulated.sequence) == 21  # 4 s at 5 Hz, not 80
    (found,) = [found for found in simulated.sequence.diagnostics if found.code == "short-path"]
    assert "after 21 of 80 frames at 5 Hz" in found.message
    assert truth.timestamps_s[[0, -1]] == pytest.approx([10.0, 14.0])
    assert truth.world_from_vehicle[10, :3, 3] == pytest.approx([-3.0, 0, -2.0])


def test_a_scene_seed_leaves_only_the_noise_to_the_seed() -> None:
    one, other = (simulate("tank", "didson", 3, seed, scene_seed=7) for seed in (1, 2))
    np.testing.assert_array_equal(one.scene.vertices_m, other.scene.vertices_m)
    assert one.sequence.groundtruth and other.sequence.groundtruth and one.sequence.odometry and other.sequence.odometry
    np.testing.assert_array_equal(
        one.sequence.groundtruth.world_from_vehicle, other.sequence.groundtruth.world_from_vehicle
    )
    np.testing.assert_array_equal(one.read_truth(1).clean, other.read_truth(1).clean)
    assert (one.sequence.read_frame(1).image != other.sequence.read_frame(1).image).mean() > 0.1
    assert (one.sequence.odometry.world_from_vehicle != other.sequence.odometry.world_from_vehicle).any()
    own = simulate("tank", "didson", 3, 1).sequence.groundtruth
    assert own and (own.world_from_vehicle != one.sequence.groundtruth.world_from_vehicle).any()


def test_sensors_added_to_a_sequence_are_those_of_its_seed() -> None:
    one, other = (simulate("tank", "didson", 3, seed, scene_seed=7).sequence for seed in (1, 2))
    moved = add_sensors(one, 2)
    assert moved.odometry and other.odometry and moved.navigation and other.navigation
    np.testing.assert_array_equal(moved.odometry.world_from_vehicle, other.odometry.world_from_vehicle)
    np.testing.assert_array_equal(moved.navigation.roll_rad, other.navigation.roll_rad)
    with pytest.raises(AssertionError, match="true poses"):
        add_sensors(replace(one, groundtruth=None), 2)
