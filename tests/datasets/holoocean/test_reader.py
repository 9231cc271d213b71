"""Reader of HoloOcean recordings, against folders written here and against recordings."""

import json
from pathlib import Path

import numpy as np
import pytest

from asfm.datasets import open_sequence
from asfm.errors import AsfmError
from asfm.geometry.poses import invert, transform
from asfm.geometry.sonar import project
from asfm.sequence import Sequence
from tests.datasets.holoocean_files import GEOMETRY, SHAPE, make_config, make_state, write_folder


def test_images_poses_and_stamps_are_those_of_the_pickles(tmp_path: Path) -> None:
    states = [make_state(index) for index in range(12)]
    sequence = open_sequence(write_folder(tmp_path / "boat", states))
    assert (sequence.kind, sequence.name, len(sequence), sequence.sonar.shape) == ("holoocean", "boat", 12, SHAPE)
    np.testing.assert_allclose(sequence.sonar.range_edges_m, np.linspace(0.5, 4.5, 17))
    np.testing.assert_allclose(np.degrees(sequence.sonar.bearing_edges_rad), np.linspace(-30, 30, 7), atol=1e-9)
    assert np.degrees(sequence.sonar.elevation_aperture_rad) == pytest.approx(12)
    np.testing.assert_array_equal(sequence.timestamps_s, 10.0 + np.arange(12))
    for frame, state in zip(sequence, states, strict=True):
        np.testing.assert_array_equal(frame.image, state["ImagingSonar"], err_msg="10.pkl comes after 9.pkl")
        assert type(frame.image) is np.ndarray
    assert sequence.groundtruth is not None and sequence.diagnostics == ()
    poses = np.stack([state["PoseSensor"] for state in states])
    np.testing.assert_allclose(sequence.groundtruth.world_from_vehicle, poses, atol=1e-6)
    np.testing.assert_array_equal(sequence.vehicle_from_sonar, np.eye(4))
    assert len(open_sequence(tmp_path / "boat" / "Data")) == 12, "the folder of the pickles is accepted too"


def test_bytes_and_out_of_range_values_become_0_to_1(tmp_path: Path) -> None:
    grey = np.arange(96, dtype=np.uint8).reshape(SHAPE)
    wild = np.zeros(SHAPE, np.float32)
    wild[0, :4] = [-0.1, 1.7, np.nan, np.inf]
    states = [make_state(0, ImagingSonar=grey), make_state(1, ImagingSonar=wild)]
    sequence = open_sequence(write_folder(tmp_path / "a", states))
    first, second = sequence
    np.testing.assert_array_equal(first.image, (grey / np.float32(255)).astype(np.float32))
    assert not first.invalid.any()
    np.testing.assert_array_equal(second.image[0, :4], [0, 1, 0, 0])
    np.testing.assert_array_equal(np.argwhere(second.invalid), [[0, 2], [0, 3]])


def test_lengths_are_divided_by_ds_factor(tmp_path: Path) -> None:
    sequence = open_sequence(write_folder(tmp_path / "a", [make_state(0), make_state(1)], make_config(ds_factor=2.0)))
    assert sequence.sonar.range_edges_m[[0, -1]] == pytest.approx([0.25, 2.25])
    assert sequence.groundtruth is not None
    np.testing.assert_allclose(sequence.groundtruth.world_from_vehicle[1, :3, 3], [0.5, 1.0, 1.5])


def test_without_usable_times_stamps_follow_the_nominal_rate(tmp_path: Path) -> None:
    without_time = [{key: value for key, value in make_state(index).items() if key != "t"} for index in range(3)]
    stuck = [make_state(index, t=1.0) for index in range(3)]
    unreliable = ["unreliable-stamps"]
    cases = {
        "none": (without_time, []),
        "stuck": (stuck, unreliable),
        "some": ([*without_time[:2], make_state(2)], unreliable),
    }
    for name, (states, codes) in cases.items():
        sequence = open_sequence(write_folder(tmp_path / name, states))
        np.testing.assert_allclose(sequence.timestamps_s, [0, 0.25, 0.5])
        assert [item.code for item in sequence.diagnostics] == codes


def test_a_pose_sensor_mounted_elsewhere_gives_no_ground_truth(tmp_path: Path) -> None:
    config = make_config(pose={"rotation": [0, 0, 0]})
    sequence = open_sequence(write_folder(tmp_path / "a", [make_state(0)], config))
    (diagnostic,) = sequence.diagnostics
    assert sequence.groundtruth is None
    assert diagnostic.code == "pose-not-of-sonar" and "rotation" in diagnostic.message


def test_an_image_of_another_size_is_reported_when_it_is_read(tmp_path: Path) -> None:
    states = [make_state(0), make_state(1, ImagingSonar=np.zeros((8, 6)))]
    sequence = open_sequence(write_folder(tmp_path / "a", states))
    with pytest.raises(AsfmError, match=r"1\.pkl: expected ImagingSonar of shape \(16, 6\).*found \(8, 6\)"):
        sequence.read_frame(1)
    with pytest.raises(AsfmError, match=r"1\.pkl: expected ImagingSonar of shape \(16, 6\).*found \(8, 6\)"):
        sequence.check_frames()


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ("{", r"cannot read a HoloOcean scenario"),
        ("[]", r"the file: "),
        ("{}", r"expected the key 'agents'"),
        (json.dumps({"agents": [{"sensors": []}]}), r"expected a sensor_type of ImagingSonar, found no sensors"),
        (json.dumps(make_config(sonar={"configuration": {"Azimuth": 60}})), r"the key 'Elevation'"),
        (json.dumps(make_config(sonar={"configuration": {**GEOMETRY, "RangeMin": 9}})), r"RangeMin below RangeMax"),
        (json.dumps(make_config(ds_factor=0)), r"ds_factor: .*found 0"),
    ],
)
def test_an_invalid_scenario_is_reported(tmp_path: Path, config: str, message: str) -> None:
    root = write_folder(tmp_path / "a", [make_state(0)])
    (root / "Config.json").write_text(config)
    with pytest.raises(AsfmError, match=rf"Config\.json.*{message}"):
        open_sequence(root)


def best_echo_after_transfer(sequence: Sequence, frame_a: int, frame_b: int, is_mirrored: bool) -> float:
    """Project the brightest pixels of one frame, at all elevations, into another by the true poses: mean best echo."""
    assert sequence.groundtruth is not None
    sonar, poses = sequence.sonar, sequence.groundtruth.world_from_vehicle
    step = -1 if is_mirrored else 1
    image_a, image_b = (sequence.read_frame(index).image[:, ::step] for index in (frame_a, frame_b))
    rows, columns = np.nonzero(image_a > np.quantile(image_a, 0.99))
    arcs_m = sonar.elevation_arc(sonar.range_m[rows], sonar.bearing_rad[columns], 21)
    seen_m = transform(invert(poses[frame_b]) @ poses[frame_a], arcs_m)
    range_m, bearing_rad, _ = project(seen_m)
    row = np.minimum(sonar.row_at_range(range_m).astype(int), sonar.shape[0] - 1)
    column = np.minimum(sonar.column_at_bearing(bearing_rad).astype(int), sonar.shape[1] - 1)
    return float(np.where(sonar.sees(seen_m), image_b[row, column], 0.0).max(axis=1).mean())


@pytest.mark.parametrize(("name", "gap", "margin"), [("holoocean_boat", 1, 1.15), ("turtle_sim", 12, 1.0)])
def test_true_poses_agree_with_the_images_and_not_with_their_mirror(
    shared_data: Path, name: str, gap: int, margin: float
) -> None:
    sequence = open_sequence(shared_data / name)
    assert len(sequence) == 60
    pairs = [(start, start + gap) for start in range(0, 60 - gap, 6)]
    upright = np.mean([best_echo_after_transfer(sequence, *pair, is_mirrored=False) for pair in pairs])
    mirrored = np.mean([best_echo_after_transfer(sequence, *pair, is_mirrored=True) for pair in pairs])
    assert upright > margin * mirrored
