"""Reader of Oculus recordings, against messages packed field by field and a real ping."""

import math
from pathlib import Path

import numpy as np
import pytest

from asfm.config import CfarConfig
from asfm.datasets import open_sequence
from asfm.datasets.native.reader import read_native
from asfm.datasets.native.writer import write_native
from asfm.datasets.oculus.reader import is_oculus, read_oculus
from asfm.errors import AsfmError
from asfm.frontend.denoising.cfar import detect_cfar
from asfm.sequence import Sequence
from tests.datasets.oculus_files import BEAMS, BEARINGS, RANGES, STEP_M, TYPES, pack_message, pack_ping


def open_bytes(folder: Path, *messages: bytes) -> Sequence:
    (folder / "a.raw").write_bytes(b"".join(messages))
    return open_sequence(folder / "a.raw")


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("data_size", [0, 1, 3])
@pytest.mark.parametrize("with_gains", [False, True])
def test_images_and_ranges_are_those_of_the_file(
    tmp_path: Path, version: int, data_size: int, with_gains: bool
) -> None:
    rng = np.random.default_rng(data_size)
    images = [rng.integers(0, np.iinfo(TYPES[data_size]).max, (RANGES, BEAMS)) for _ in range(3)]
    gains = rng.integers(1, 90, RANGES) if with_gains else None
    status = pack_message(b"whatever", number=0x80)
    pings = [pack_ping(image, version, data_size, gains, start=i) for i, image in enumerate(images)]
    sequence = open_bytes(tmp_path, status, pings[0], status, *pings[1:], status)
    assert (sequence.kind, len(sequence), sequence.sonar.shape) == ("oculus", 3, (RANGES, BEAMS))
    np.testing.assert_allclose(sequence.sonar.range_m, STEP_M * (np.arange(RANGES) + 0.5), rtol=1e-12)
    expected = np.stack(images)[..., ::-1].astype(float)
    if gains is not None:
        expected /= np.sqrt(gains)[:, None]
    expected /= 255 if (data_size, with_gains) == (0, False) else expected.max()
    for index, frame in enumerate(sequence):
        np.testing.assert_allclose(frame.image, expected[index], rtol=1e-6)
        assert frame.image.dtype == np.float32 and not frame.invalid.any() and frame.decibel_span is None
        assert frame.timestamp_s == sequence.timestamps_s[index]


@pytest.mark.parametrize(("gamma", "power"), [(255, 1.0), (0, 1.0), (127, 255 / 127), (51, 5.0)])
@pytest.mark.parametrize("data_size", [0, 1])
def test_the_gamma_is_inverted(tmp_path: Path, gamma: int, power: float, data_size: int) -> None:
    image = np.linspace(0, 255, RANGES * BEAMS).round().reshape(RANGES, BEAMS)
    found = open_bytes(tmp_path, pack_ping(image, gamma=gamma, data_size=data_size)).read_frame(0).image
    np.testing.assert_allclose(found[:, ::-1], (image / 255) ** power, rtol=1e-5)


def test_bearings_of_the_file_are_positive_to_starboard(tmp_path: Path) -> None:
    image = np.zeros((RANGES, BEAMS))
    image[2, 1] = 255  # at -12 degrees in the file: to port
    sequence = open_bytes(tmp_path, pack_ping(image))
    np.testing.assert_allclose(np.degrees(sequence.sonar.bearing_rad), [-30, -15, -1, 12, 30], atol=1e-12)
    row, column = np.argwhere(sequence.read_frame(0).image == 1.0)[0]
    assert row == 2 and np.degrees(sequence.sonar.bearing_rad[column]) == pytest.approx(12)


def test_the_elevation_aperture_depends_on_the_frequency_mode(tmp_path: Path) -> None:
    for mode, aperture_deg, name in ((1, 20, "low frequency"), (2, 12, "high frequency")):
        sequence = open_bytes(tmp_path, pack_ping(mode=mode))
        assert np.degrees(sequence.sonar.elevation_aperture_rad) == pytest.approx(aperture_deg)
        assert name in sequence.sonar.name and sequence.diagnostics == ()
    (diagnostic,) = open_bytes(tmp_path, pack_ping(mode=9)).diagnostics
    assert diagnostic.code == "assumed-aperture"
    assert "mode 9" in diagnostic.message and "12 degrees" in diagnostic.message
    other = read_oculus(tmp_path / "a.raw", elevation_aperture_deg=15)
    assert np.degrees(other.sonar.elevation_aperture_rad) == pytest.approx(15) and other.diagnostics == ()


def test_stamps_are_those_of_a_clock_in_seconds(tmp_path: Path) -> None:
    starts = (100.0, 100.3, 100.4)
    clocked = open_bytes(tmp_path, *[pack_ping(version=2, start=start) for start in starts])
    np.testing.assert_array_equal(clocked.timestamps_s, starts)
    assert clocked.diagnostics == ()


@pytest.mark.parametrize(
    ("version", "rate", "starts", "hz"),
    [
        (1, 3, (100, 200, 300), 5),
        (1, 195, (100, 200, 300), 10),
        (2, 1, (5.0, 5.0, 6.0), 15),
        (2, 1, (5.0, 4.0, 6.0), 15),
        (2, 0, (5.0, math.nan, 6.0), 10),
        (2, 0, (1e9, 1.1e9, 1.2e9), 10),
    ],
)
def test_other_stamps_are_evenly_spaced(
    tmp_path: Path, version: int, rate: int, starts: tuple[float, ...], hz: float
) -> None:
    sequence = open_bytes(tmp_path, *[pack_ping(version=version, rate=rate, start=start) for start in starts])
    np.testing.assert_allclose(sequence.timestamps_s, np.arange(3) / hz)
    (diagnostic,) = sequence.diagnostics
    assert diagnostic.code == "unreliable-stamps" and f"evenly at {hz:g} Hz" in diagnostic.message


def test_a_small_change_of_the_range_resolution_gives_a_diagnostic(tmp_path: Path) -> None:
    pings = pack_ping(version=2, start=1), pack_ping(version=2, start=2, step_m=0.2501)
    (diagnostic,) = open_bytes(tmp_path, *pings).diagnostics
    assert diagnostic.code == "variable-range-resolution" and "0.25 to 0.2501 m" in diagnostic.message


GOOD = pack_ping()


@pytest.mark.parametrize(
    ("messages", "message"),
    [
        ((pack_ping(gains=np.array([9, 9, 0, 9, 9, 9])),), r"frame 0: expected a gain above 0 .*found 0 in row 2"),
        ((GOOD, pack_ping(np.zeros((7, BEAMS)))), r"frame 1: expected ranges x beams \(6, 5\) .*found \(7, 5\): split"),
        ((GOOD, pack_ping(version=2)), r"frame 1: expected message version 1 as in frame 0, found 2: split"),
        ((GOOD, pack_ping(mode=1)), r"frame 1: expected frequency mode 2 as in frame 0, found 1"),
        ((pack_ping(gamma=1),), r"frame 0: expected a gamma of 13\.\.255 \(of 255\), or 0 for none, found 1"),
        ((GOOD, pack_ping(gamma=127)), r"frame 1: expected gamma 1\.0 as in frame 0, found 0\.498: split"),
        ((GOOD, pack_ping(data_size=1)), r"frame 1: expected bits per sample 8 as in frame 0, found 16"),
        ((GOOD, pack_ping(step_m=0.5)), r"frame 1: expected range resolution 0\.25 m as in frame 0, found 0\.5 m"),
        ((GOOD, pack_ping(bearings=(*BEARINGS[:-1], 3001))), r"frame 1: expected bearings .*found -30\.\.30\.01 deg"),
    ],
)
def test_invalid_gains_and_changed_settings_are_reported_in_one_line(
    tmp_path: Path, messages: tuple[bytes, ...], message: str
) -> None:
    with pytest.raises(AsfmError, match=rf"a\.raw.*{message}") as error:
        open_bytes(tmp_path, *messages)
    assert "\n" not in str(error.value)


def test_a_file_cut_off_after_opening_is_reported(tmp_path: Path) -> None:
    sequence = open_bytes(tmp_path, GOOD, GOOD)
    (tmp_path / "a.raw").write_bytes((GOOD + GOOD)[:-10])
    sequence.read_frame(0)
    with pytest.raises(AsfmError, match=r"frame 1: expected 30 bytes of samples, found 20"):
        sequence.read_frame(1)
    with pytest.raises(IndexError):
        sequence.read_frame(2)


def test_text_and_folders_are_not_recognised(tmp_path: Path) -> None:
    path = tmp_path / "a.raw"
    for content in (b"SONAR LOG of the dive\n" * 9, b"", b"SO"):
        path.write_bytes(content)
        assert not is_oculus(path)
    assert not is_oculus(tmp_path)


def test_a_real_ping_reads_and_survives_conversion(tmp_path: Path, shared_data: Path) -> None:
    sequence = open_sequence(shared_data / "oculus_ping" / "one_ping_8bit.raw")
    assert (len(sequence), sequence.sonar.shape, sequence.diagnostics) == (1, (703, 256), ())
    assert sequence.sonar.range_edges_m[-1] == pytest.approx(1.998, abs=1e-3)
    np.testing.assert_allclose(np.degrees(sequence.sonar.bearing_rad[[0, -1]]), [-30, 30], atol=1e-9)
    image = sequence.read_frame(0).image
    rows = np.corrcoef(image[260:400].ravel(), image[261:401].ravel())[0, 1]
    assert rows > 0.3, "neighbouring rows are similar, so the row stride is right"
    config = CfarConfig()
    alarms = detect_cfar(image, np.ones(image.shape, dtype=bool), config)[560:680].mean()
    assert alarms == pytest.approx(config.false_alarm_probability, rel=0.15), (
        "the rate that was set: images are amplitudes"
    )
    write_native(tmp_path / "native", sequence, bits=16)
    np.testing.assert_allclose(read_native(tmp_path / "native").read_frame(0).image, image, atol=1 / 65535)
