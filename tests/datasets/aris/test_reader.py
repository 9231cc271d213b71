"""Reader of ARIS recordings, against files packed field by field and the manufacturer's sample."""

from pathlib import Path

import numpy as np
import pytest

from asfm.datasets import open_sequence
from asfm.datasets.aris.reader import read_aris
from asfm.datasets.native.reader import read_native
from asfm.datasets.native.writer import write_native
from asfm.errors import AsfmError
from asfm.types import FloatArray
from tests.datasets.aris_files import DELAY_US, PERIOD_US, SAMPLES, SPEED_M_S, pack_header, write_file


def make_frames(count: int = 3, beams: int = 128, seed: int = 0) -> tuple[list[bytes], list[np.ndarray]]:
    rng = np.random.default_rng(seed)
    images = [rng.integers(0, 256, (SAMPLES, beams), dtype=np.uint8) for _ in range(count)]
    return [
        pack_header(1_700_000_000_000_000 + 100_000 * i) + image.tobytes() for i, image in enumerate(images)
    ], images


def test_images_ranges_and_stamps_are_those_of_the_file(tmp_path: Path) -> None:
    frames, images = make_frames()
    sequence = open_sequence(write_file(tmp_path / "a.bin", frames))
    assert (sequence.kind, len(sequence), sequence.sonar.shape) == ("aris", 3, (SAMPLES, 128))
    np.testing.assert_allclose(sequence.timestamps_s, 1.7e9 + 0.1 * np.arange(3), rtol=0, atol=1e-6)
    near_m, step_m = DELAY_US * 1e-6 * SPEED_M_S / 2, PERIOD_US * 1e-6 * SPEED_M_S / 2
    np.testing.assert_allclose(sequence.sonar.range_edges_m, near_m + step_m * np.arange(SAMPLES + 1), rtol=1e-12)
    assert np.degrees(sequence.sonar.elevation_aperture_rad) == pytest.approx(14)
    for frame, image in zip(sequence, images, strict=True):
        np.testing.assert_array_equal(frame.image, (image / np.float32(255)).astype(np.float32))
        assert frame.image.dtype == np.float32 and not frame.invalid.any()


def test_beam_0_is_the_starboard_most(tmp_path: Path) -> None:
    """The manufacturer numbers beams from right to left, and bearings to starboard are negative."""
    image = np.zeros((SAMPLES, 128), np.uint8)
    image[5, 3] = 255
    sequence = read_aris(write_file(tmp_path / "a.aris", [pack_header(1) + image.tobytes()]))
    row, column = np.argwhere(sequence.read_frame(0).image == 1.0)[0]
    assert row == 5
    assert np.degrees(sequence.sonar.bearing_rad[column]) == pytest.approx(-15.0 + 3 * 0.23, abs=0.1)


BODY = bytes(SAMPLES * 128)
GOOD = [pack_header(1_000_000) + BODY, pack_header(2_000_000) + BODY]


@pytest.mark.parametrize("time_us", [2_000_000, 1_500_000])
def test_stamps_that_do_not_increase_are_refused(tmp_path: Path, time_us: int) -> None:
    path = write_file(tmp_path / "a.aris", [*GOOD, pack_header(time_us) + BODY])
    message = rf"a\.aris, frame 2: expected a time after 2\.000000 s .*found {time_us / 1e6:.6f} s"
    with pytest.raises(AsfmError, match=message) as error:
        open_sequence(path)
    assert "\n" not in str(error.value)


def test_a_file_cut_off_after_opening_is_reported(tmp_path: Path) -> None:
    path = write_file(tmp_path / "a.aris", GOOD)
    sequence = read_aris(path)
    path.write_bytes(path.read_bytes()[:-100])
    sequence.read_frame(0)
    with pytest.raises(AsfmError, match=r"frame 1: expected 2560 bytes of samples, found 2460"):
        sequence.read_frame(1)
    with pytest.raises(IndexError):
        sequence.read_frame(2)


def test_a_varying_sound_speed_gives_a_diagnostic(tmp_path: Path) -> None:
    frames = [pack_header(1, speed_m_s=1440.0) + BODY, pack_header(2, speed_m_s=1441.0) + BODY]
    (diagnostic,) = read_aris(write_file(tmp_path / "a.aris", frames)).diagnostics
    assert diagnostic.code == "variable-sound-speed" and diagnostic.severity == "warning"
    assert "1440.00 to 1441.00 m/s" in diagnostic.message


def test_the_sample_of_the_manufacturer_is_read(shared_data: Path) -> None:
    path = shared_data / "aris" / "sample.aris"
    sequence = open_sequence(path)
    assert (len(sequence), sequence.sonar.shape) == (6, (2000, 48))
    assert sequence.sonar.range_edges_m[0] == pytest.approx(3.2976, abs=1e-3)
    assert sequence.sonar.range_edges_m[-1] - sequence.sonar.range_edges_m[0] == pytest.approx(20.103, abs=1e-3)
    assert "telephoto" in sequence.sonar.name
    (diagnostic,) = sequence.diagnostics
    assert diagnostic.code == "assumed-aperture" and "telephoto" in diagnostic.message
    images: FloatArray = np.stack([frame.image for frame in sequence]).astype(np.float64)
    neighbours = np.corrcoef(images[2].ravel(), images[3].ravel())[0, 1]
    mirrored = np.corrcoef(images[2].ravel(), images[3][:, ::-1].ravel())[0, 1]
    assert neighbours > mirrored, "the sonar hardly moved, so consecutive images agree"


def test_the_decibel_span_survives_conversion(tmp_path: Path, shared_data: Path) -> None:
    recording = read_aris(shared_data / "aris" / "sample.aris")
    assert recording.read_frame(0).decibel_span == 80.0
    write_native(tmp_path / "native", recording)
    again = read_native(tmp_path / "native").read_frame(0)
    assert again.decibel_span == 80.0
    np.testing.assert_array_equal(again.image, recording.read_frame(0).image)
