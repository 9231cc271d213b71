"""Schema of sequence.yaml: defaults, units, and refused values."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.datasets.native.reader import read_native
from asfm.datasets.native.sequence_yaml import MountSettings, NoiseSettings, read_settings
from asfm.datasets.native.writer import write_native
from asfm.errors import AsfmError
from asfm.geometry.poses import make_pose
from asfm.types import SensorNoise
from tests.datasets.sequences import make_sequence


@pytest.mark.parametrize(
    ("bearings", "message"),
    [
        ("bearing_deg: [5, 5]", r"two different bearing_deg"),
        ("bearings_deg: [0, 1, 3, 2, 4, 5, 6, 7]", r"all increase or all decrease"),
        ("bearings_deg: [0, 1, 2]", r"expected 8 sonar\.bearings_deg.*found 3"),
        ("bearings_deg: [0, 1, 2, 3, 4, 5, 6, .inf]", r"bearings_deg\.7"),
        ("name: x", r"expected either bearing_deg"),
    ],
)
def test_invalid_bearings_are_refused(tmp_path: Path, bearings: str, message: str) -> None:
    write_native(tmp_path / "sequence", make_sequence())
    text = f"sonar:\n  range_m: [0, 1]\n  elevation_aperture_deg: 12\n  {bearings}\n"
    (tmp_path / "sequence" / "sequence.yaml").write_text(text)
    with pytest.raises(AsfmError, match=message):
        read_native(tmp_path / "sequence")


SONAR = "sonar: {range_m: [0.5, 4], bearing_deg: [-30, 30], elevation_aperture_deg: 12}\n"


def write_settings(folder: Path, text: str) -> Path:
    (folder / "sequence.yaml").write_text(SONAR + text)
    return folder / "sequence.yaml"


def test_only_the_sonar_is_required(tmp_path: Path) -> None:
    settings = read_settings(write_settings(tmp_path, ""))
    assert settings.sonar.name == "unnamed sonar" and settings.sonar.decibel_span is None
    np.testing.assert_array_equal(settings.vehicle_from_sonar.pose(), np.eye(4))
    noise = settings.noise.sensor_noise()
    np.testing.assert_allclose(dataclasses.astuple(noise), dataclasses.astuple(SensorNoise()), rtol=1e-14)


def test_a_mounting_is_read_as_a_pose(tmp_path: Path) -> None:
    half = np.sqrt(0.5)
    text = f"vehicle_from_sonar: {{translation_m: [1, 2, 3], quaternion_xyzw: [0, 0, {half}, {half}]}}\n"
    pose = read_settings(write_settings(tmp_path, text)).vehicle_from_sonar.pose()
    np.testing.assert_allclose(pose, [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]], atol=1e-12)


def test_a_pose_survives_its_settings() -> None:
    rng = np.random.default_rng(0)
    for pose in make_pose(rng.normal(size=(9, 3)), Rotation.random(9, rng=rng)):
        np.testing.assert_allclose(MountSettings.from_pose(pose).pose(), pose, atol=1e-12)


def test_noise_is_stated_in_degrees_and_returned_in_radians(tmp_path: Path) -> None:
    text = "noise: {odometry: {rotation_deg: 180}, navigation: {roll_deg: 90, pitch_deg: 45, z_m: 0.5}}\n"
    noise = read_settings(write_settings(tmp_path, text)).noise.sensor_noise()
    assert noise.odometry_translation_m == SensorNoise().odometry_translation_m
    assert noise.odometry_rotation_rad == pytest.approx(np.pi)
    assert (noise.navigation_roll_rad, noise.navigation_pitch_rad) == pytest.approx((np.pi / 2, np.pi / 4))
    assert noise.navigation_z_m == 0.5


@pytest.mark.parametrize("noise", [SensorNoise(), SensorNoise(0.1, 0.2, 0.3, 0.4, 0.5)])
def test_noise_survives_its_settings(noise: SensorNoise) -> None:
    found = NoiseSettings.from_sensor_noise(noise).sensor_noise()
    np.testing.assert_allclose(dataclasses.astuple(found), dataclasses.astuple(noise), rtol=1e-14)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("colour: red\n", r"unknown key 'colour': remove it or correct its name"),
        ("noise: {odometry: {drift: 1}}\n", r"unknown key 'noise\.odometry\.drift'"),
        (
            "noise: {odometry: {rotation_deg: 0}}\n",
            r"noise\.odometry\.rotation_deg: .*equal to 0.000000001, found 0",
        ),
        ("noise: {navigation: {z_m: .inf}}\n", r"noise\.navigation\.z_m: .*finite"),
        ("vehicle_from_sonar: {quaternion_xyzw: [0, 0, 0, 0]}\n", r"expected a unit quaternion, found \[0\.0"),
        ("vehicle_from_sonar: {translation_m: [1, 2]}\n", r"vehicle_from_sonar\.translation_m"),
        ("vehicle_from_sonar: " + "x" * 999 + "\n", r"vehicle_from_sonar: .*found 'x{70,80}\.\.\."),
    ],
)
def test_a_fault_is_reported_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = write_settings(tmp_path, text)
    with pytest.raises(AsfmError, match=rf"sequence\.yaml: .*{message}") as error:
        read_settings(path)
    assert "\n" not in str(error.value)
