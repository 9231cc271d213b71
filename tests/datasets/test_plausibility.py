"""Plausibility of a recording: usual values pass without a word, the same ones in another unit do not."""

import dataclasses
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asfm.datasets import open_sequence
from asfm.datasets.plausibility import check_plausibility
from asfm.diagnostics import Diagnostic
from asfm.errors import AsfmError
from asfm.geometry.poses import make_pose
from asfm.geometry.sonar import SonarModel
from asfm.sequence import Sequence
from asfm.types import Frame, Navigation, Trajectory

WHERE = Path("recording")
COUNT = 12
FINDINGS = {
    "implausible-field-of-view",
    "implausible-range",
    "implausible-stamps",
    "implausible-motion",
    "saturated-images",
    "images-out-of-order",
}


def make_sonar(
    field_deg: float = 60.0, aperture_deg: float = 14.0, window_m: tuple[float, float] = (0.5, 8.0), beams: int = 96
) -> SonarModel:
    half_rad = float(np.radians(field_deg)) / 2
    return SonarModel.evenly_spaced(
        "sonar", window_m, (-half_rad, half_rad), (200, beams), float(np.radians(aperture_deg))
    )


def make_sequence(
    sonar: SonarModel | None = None, step_s: float = 0.2, metres: float = 1.0, z_m: float = -3.0, bright: float = 0.0
) -> Sequence:
    """Make a sequence at 0.5 m/s with all sensors, whose lengths are in units of 1 / ``metres``."""
    model = sonar or make_sonar()
    stamps_s = step_s * np.arange(COUNT, dtype=np.float64)
    poses = make_pose(
        np.outer(0.1 * metres * np.arange(COUNT, dtype=np.float64), [1.0, 0, 0]), Rotation.identity(COUNT)
    )
    image = np.full(model.shape, 0.4, np.float32)
    image.ravel()[: round(bright * image.size)] = 1
    navigation = Navigation(
        stamps_s, z_m - 0.01 * metres * np.arange(COUNT, dtype=np.float64), np.zeros(COUNT), np.zeros(COUNT)
    )
    return Sequence(
        name="here",
        sonar=model,
        timestamps_s=stamps_s,
        read_frame=lambda index: Frame(index, float(stamps_s[index]), image, np.zeros(model.shape, bool)),
        odometry=Trajectory(stamps_s, poses),
        navigation=navigation,
        groundtruth=Trajectory(stamps_s, poses),
    )


def codes(sequence: Sequence) -> list[str]:
    return [item.code for item in check_plausibility(WHERE, sequence).diagnostics]


@pytest.mark.parametrize(
    ("field_deg", "aperture_deg", "window_m", "beams", "step_s"),
    [
        (28.8, 1.0, (0.4, 9.0), 96, 0.1),  # DIDSON with a concentrator lens
        (15.0, 3.0, (1.0, 20.0), 128, 0.2),  # ARIS with a telephoto lens
        (130.0, 20.0, (0.1, 200.0), 512, 1.0),  # Oculus M370 at its longest range
        (40.0, 20.0, (0.1, 5.0), 512, 1 / 40),  # Oculus M3000d
        (360.0, 30.0, (0.5, 100.0), 400, 4.0),  # scanning sonar
        (90.0, 28.0, (0.5, 60.0), 256, 0.1),
    ],
)
def test_sonars_that_exist_pass_without_a_word(
    field_deg: float, aperture_deg: float, window_m: tuple[float, float], beams: int, step_s: float
) -> None:
    sequence = make_sequence(make_sonar(field_deg, aperture_deg, window_m, beams), step_s)
    assert check_plausibility(WHERE, sequence) is sequence


@pytest.mark.parametrize("field_deg", [15.0, 30.0, 60.0, 70.0, 130.0, 360.0])
def test_bearings_in_radians_are_told(field_deg: float) -> None:
    (found,) = check_plausibility(WHERE, make_sequence(make_sonar(float(np.radians(field_deg))))).diagnostics
    assert found.code == "implausible-field-of-view" and "radians?" in found.message
    assert f"rad are {field_deg:g} deg" in found.message


def test_beams_too_close_together_are_told_without_a_unit() -> None:
    (found,) = check_plausibility(WHERE, make_sequence(make_sonar(10.0, beams=1000))).diagnostics
    assert found.code == "implausible-field-of-view" and "radians" not in found.message


@pytest.mark.parametrize(("aperture_deg", "hint"), [(0.24, "radians?"), (0.52, "radians?"), (120.0, "wider")])
def test_apertures_that_no_sonar_has_are_told(aperture_deg: float, hint: str) -> None:
    (found,) = check_plausibility(WHERE, make_sequence(make_sonar(aperture_deg=aperture_deg))).diagnostics
    assert found.code == "implausible-field-of-view" and "elevation aperture" in found.message and hint in found.message


def test_more_than_a_full_turn_is_refused() -> None:
    with pytest.raises(AsfmError, match=r"recording: expected beams within a full turn, found .* 361\.0 deg"):
        check_plausibility(WHERE, make_sequence(make_sonar(361.0)))


@pytest.mark.parametrize("factor", [1000.0, 100.0, 1e-3])
@pytest.mark.parametrize("window_m", [(0.5, 8.0), (0.7, 2.8), (0.1, 30.0)])
def test_ranges_in_other_units_are_told(factor: float, window_m: tuple[float, float]) -> None:
    sonar = make_sonar(window_m=(factor * window_m[0], factor * window_m[1]))
    assert "implausible-range" in codes(make_sequence(sonar, step_s=0.2))


def test_an_echo_must_return_before_the_next_ping_unless_the_stamps_are_nominal() -> None:
    sequence = make_sequence(make_sonar(window_m=(1.0, 80.0)), step_s=0.05)
    assert codes(sequence) == ["implausible-range"]
    nominal = dataclasses.replace(sequence, diagnostics=(Diagnostic("unreliable-stamps", "nominal"),))
    assert codes(nominal) == ["unreliable-stamps"]
    assert codes(make_sequence(make_sonar(window_m=(1.0, 80.0)), step_s=0.12)) == []


@pytest.mark.parametrize(("step_s", "hint"), [(200.0, "milliseconds"), (25.0, "milliseconds"), (2.3e-6, "days")])
def test_frames_too_far_apart_or_too_close_are_told(step_s: float, hint: str) -> None:
    sequence = dataclasses.replace(make_sequence(step_s=step_s), odometry=None, navigation=None, groundtruth=None)
    found = [item for item in check_plausibility(WHERE, sequence).diagnostics if item.code == "implausible-stamps"]
    assert len(found) == 1 and found[0].message.startswith("the stamps of frames") and hint in found[0].message


@pytest.mark.parametrize("name", ["odometry", "navigation"])
def test_a_sensor_in_milliseconds_is_told_though_the_frames_are_in_seconds(name: str) -> None:
    sequence = make_sequence()
    sensor = getattr(sequence, name)
    late = dataclasses.replace(sensor, timestamps_s=1000 * sensor.timestamps_s)
    (found,) = check_plausibility(WHERE, dataclasses.replace(sequence, **{name: late})).diagnostics
    assert found.code == "implausible-stamps" and f"stamps of {name}" in found.message


def test_positions_in_millimetres_are_told_sensor_by_sensor() -> None:
    found = check_plausibility(WHERE, make_sequence(metres=1000.0)).diagnostics
    assert [item.code for item in found] == ["implausible-motion"] * 3
    assert ["odometry" in item.message for item in found] == [True, False, False]
    assert "500 m/s" in found[0].message and "millimetres" in found[0].message


def test_a_step_longer_than_the_sonar_sees_is_told() -> None:
    slow = make_sequence(make_sonar(window_m=(0.1, 2.0)), metres=25.0)  # 12.5 m/s, 2.5 m a frame
    assert codes(slow) == ["implausible-motion", "implausible-motion"]
    assert codes(make_sequence(make_sonar(window_m=(0.1, 3.0)), metres=25.0)) == []


def test_depth_below_every_ocean_is_told() -> None:
    (found,) = check_plausibility(WHERE, make_sequence(z_m=-20000.0)).diagnostics
    assert found.code == "implausible-motion" and "z_m reaches" in found.message


def test_a_vehicle_at_rest_with_one_pose_passes() -> None:
    one = Trajectory(np.zeros(1), np.eye(4)[None])
    assert codes(dataclasses.replace(make_sequence(), odometry=one, navigation=None)) == []


def test_positive_heights_are_explained_where_no_odometry_contradicts_them() -> None:
    sequence = make_sequence(z_m=3.0)
    assert codes(sequence) == []
    (found,) = check_plausibility(WHERE, dataclasses.replace(sequence, odometry=None)).diagnostics
    assert (found.code, found.severity) == ("positive-height", "info") and "2.89 to 3.00 m" in found.message
    assert codes(dataclasses.replace(make_sequence(z_m=0.05), odometry=None)) == []
    assert codes(dataclasses.replace(make_sequence(z_m=0.105), odometry=None)) == ["positive-height"]


def test_saturated_pixels_beyond_some_per_cent_are_told() -> None:
    assert codes(make_sequence(bright=0.02)) == []
    (found,) = check_plausibility(WHERE, make_sequence(bright=0.1)).diagnostics
    assert found.code == "saturated-images" and found.message.startswith("10.0 % of the pixels")
    assert found.frames == ((0, 0), (6, 6), (11, 11))


def test_invalid_pixels_are_never_saturated() -> None:
    sequence = make_sequence(bright=0.1)
    read = sequence.read_frame

    def mask(index: int) -> Frame:
        frame = read(index)
        return dataclasses.replace(frame, invalid=frame.image >= (1 if index else 0))

    assert codes(dataclasses.replace(sequence, read_frame=mask)) == []


def test_frames_that_cannot_be_read_are_left_to_the_run() -> None:
    def fail(index: int) -> Frame:
        raise AsfmError(f"frame {index}")

    assert codes(dataclasses.replace(make_sequence(), read_frame=fail)) == []


def list_recordings(folder: Path) -> list[Path]:
    marks = ("sequence.yaml", "Config.json")
    return [*(path.parent for mark in marks for path in sorted(folder.rglob(mark))), folder / "aris" / "sample.aris"]


def test_no_public_recording_is_implausible(shared_data: Path) -> None:
    for path in list_recordings(shared_data):
        assert not FINDINGS & {item.code for item in open_sequence(path).diagnostics}, path


def scale_range(text: str) -> str:
    return text.replace("- 0.5", "- 500").replace("- 8.0", "- 8000")


def to_radians(text: str) -> str:
    return text.replace("35.0", "0.610865")


@pytest.mark.parametrize(
    ("change", "code"), [(scale_range, "implausible-range"), (to_radians, "implausible-field-of-view")]
)
def test_opening_a_folder_checks_it(shared_data: Path, tmp_path: Path, change: Callable[[str], str], code: str) -> None:
    original = shared_data / "simulated_seafloor"
    for name in ("frames.csv", "odometry.tum"):
        shutil.copy(original / name, tmp_path)
    shutil.copytree(original / "frames", tmp_path / "frames")
    (tmp_path / "sequence.yaml").write_text(change((original / "sequence.yaml").read_text()))
    assert [item.code for item in open_sequence(tmp_path).diagnostics] == [code]
