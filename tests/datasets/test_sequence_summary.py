"""Summary of a sequence as rows of text."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.datasets import open_sequence
from asfm.datasets.sequence_summary import path_length_m, summarise_sequence
from asfm.diagnostics import Diagnostic
from asfm.geometry.poses import make_pose
from asfm.geometry.sonar import SonarModel
from asfm.sequence import Sequence
from asfm.types import Frame, Navigation, Trajectory

DIAGNOSTICS = (
    Diagnostic("variable-sound-speed", "the sound speed varies"),
    Diagnostic("duplicate-frames", "two frames repeat", ((3, 4),)),
    Diagnostic("assumed-aperture", "14 degrees", severity="info"),
)


def make_sequence(count: int = 11) -> Sequence:
    sonar = SonarModel("test sonar", np.linspace(1, 2, 5), np.radians([-10.0, -4.0, 0.0, 5.0]), np.radians(12))
    stamps_s = 0.5 * np.arange(count, dtype=np.float64)
    poses = make_pose(np.outer(np.arange(count), [0.0, 3.0, 4.0]), Rotation.identity(count))
    image = np.full(sonar.shape, 0.25, np.float32)
    invalid = np.zeros(sonar.shape, bool)
    invalid[0] = True
    return Sequence(
        name="here",
        sonar=sonar,
        timestamps_s=stamps_s,
        read_frame=lambda index: Frame(index, float(stamps_s[index]), image, invalid),
        vehicle_from_sonar=make_pose(np.array([0.3, 0.0, 0.4]), Rotation.from_euler("y", 20, degrees=True)),
        odometry=Trajectory(stamps_s, poses),
        kind="native",
        diagnostics=DIAGNOSTICS,
    )


def test_the_summary_has_numbers_with_units() -> None:
    rows = summarise_sequence(make_sequence())
    table = dict(rows)
    assert table["frames"] == "11" and table["format"] == "native"
    assert table["duration"] == "5.00 s" and table["rate"] == "2 Hz"
    assert table["image"] == "5 ranges x 4 beams"
    assert table["range"] == "0.875 to 2.125 m, 250.00 mm a row"
    assert table["bearing"].startswith("-13.00 to 7.50 deg") and "unevenly" in table["bearing"]
    assert table["elevation aperture"] == "12.0 deg"
    assert table["odometry"] == "11 poses, path of 50.00 m"
    assert table["navigation"] == table["ground truth"] == table["hand tracks"] == "none"
    assert table["lever arm"] == "0.500 m, turned by 20.0 deg"
    assert table["invalid pixels"] == "20.00 % of the first frame"
    assert table["echo level"].startswith("mean 0.250")
    assert rows[-3:] == [
        ("warning", "the sound speed varies [variable-sound-speed]"),
        ("warning", "two frames repeat [duplicate-frames]"),
        ("info", "14 degrees [assumed-aperture]"),
    ]
    assert all("\n" not in value for _, value in rows)


def test_one_frame_can_be_summarised() -> None:
    table = dict(summarise_sequence(make_sequence(count=1)))
    assert (table["frames"], table["duration"], table["rate"]) == ("1", "0.00 s", "one frame")
    assert table["odometry"] == "1 pose, path of 0.00 m"


def test_the_path_length_is_the_sum_of_the_steps() -> None:
    there_and_back = make_pose(np.array([[0.0, 0, 0], [0, 0, 2], [0, 0, 0]]), Rotation.identity(3))
    assert path_length_m(Trajectory(np.arange(3.0), there_and_back)) == pytest.approx(4)


@pytest.mark.parametrize(
    ("z_m", "meaning"),
    [
        ([1.8, 2.4], "z from 1.80 to 2.40 m, above the origin (z points up: a depth must be negated)"),
        ([-2.4, -1.8], "z from -2.40 to -1.80 m, below the origin (z points up)"),
        ([-0.1, 0.1], "z from -0.10 to 0.10 m, about the origin (z points up)"),
    ],
)
def test_the_sign_of_heights_is_explained(z_m: list[float], meaning: str) -> None:
    navigation = Navigation(np.arange(2.0), np.array(z_m), np.zeros(2), np.zeros(2))
    table = dict(summarise_sequence(dataclasses.replace(make_sequence(), navigation=navigation)))
    assert table["navigation"] == f"2 readings, {meaning}"


def test_recordings_can_be_summarised(shared_data: Path) -> None:
    table = dict(summarise_sequence(open_sequence(shared_data / "oculus_tank_a")))
    assert table["hand tracks"] == "328 observations of 4 landmarks"
    assert "evenly spaced" in table["bearing"] and "unevenly" not in table["bearing"]
    table = dict(summarise_sequence(open_sequence(shared_data / "aris" / "sample.aris")))
    assert "unevenly" in table["bearing"] and table["format"] == "aris"
