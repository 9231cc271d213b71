"""Frame headers of ARIS recordings, against headers packed field by field."""

from pathlib import Path

import pytest

from asfm.datasets.aris.frame_headers import check_settings, read_headers
from asfm.datasets.aris.reader import read_aris
from asfm.errors import AsfmError
from tests.datasets.aris_files import DELAY_US, PERIOD_US, SAMPLES, SPEED_M_S, pack_header, write_file

BODY = bytes(SAMPLES * 128)
GOOD = [pack_header(1_000_000) + BODY, pack_header(2_000_000) + BODY]


def test_headers_have_the_fields_that_were_written(tmp_path: Path) -> None:
    headers = read_headers(write_file(tmp_path / "a.aris", GOOD))
    assert headers["frame_time_us"].tolist() == [1_000_000, 2_000_000]
    for name, expected in (
        ("ping_mode", 9),
        ("sample_period_us", PERIOD_US),
        ("sound_speed_m_s", SPEED_M_S),
        ("samples_per_beam", SAMPLES),
        ("sample_start_delay_us", DELAY_US),
        ("large_lens", 0),
        ("system_type", 1),
        ("reordered_samples", 1),
    ):
        assert headers[name].tolist() == [expected, expected]


@pytest.mark.parametrize(("mode", "beams"), [(1, 48), (2, 48), (3, 96), (5, 96), (6, 64), (8, 64), (9, 128), (12, 128)])
def test_the_ping_mode_gives_the_number_of_beams(tmp_path: Path, mode: int, beams: int) -> None:
    path = write_file(tmp_path / "a.aris", [pack_header(1, ping_mode=mode) + bytes(SAMPLES * beams)])
    assert read_aris(path).sonar.shape == (SAMPLES, beams)


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        ([], r"expected at least one frame, found 1024 bytes"),
        (
            [*GOOD, pack_header(3_000_000) + BODY[:-7]],
            r"expected 11776 .*found 11769: .*after 2 complete frames.*to 8192",
        ),
        ([*GOOD, b"\0" * 500], r"found 8692: .*after 2 complete frames"),
        ([*GOOD, pack_header(3_000_000, samples=10) + BODY], r"frame 2: expected 20 samples x 128.*found 10 x 128"),
        ([*GOOD, pack_header(3_000_000, ping_mode=1) + BODY], r"frame 2: expected 20 samples x 128.*found 20 x 48"),
        ([*GOOD, pack_header(3_000_000, delay_us=9) + BODY], r"frame 2: expected sample_start_delay_us 4593.*found 9"),
        (
            [*GOOD, pack_header(3_000_000, version=b"DDF\x04") + BODY],
            r"frame 2: expected a frame header with the bytes DDF 05",
        ),
        ([pack_header(1, ping_mode=0) + BODY], r"frame 0: expected a ping mode of 1\.\.12, found 0"),
        ([pack_header(1, ping_mode=13) + BODY], r"found 13"),
        ([pack_header(1, samples=0) + BODY], r"frame 0: .*samples per beam, found 0"),
        ([pack_header(1, samples=2**31) + BODY], r"frame 0: .*samples per beam, found 2147483648"),
        ([pack_header(1, reordered=0) + BODY], r"frame 0: expected samples in beam order"),
        ([pack_header(1, speed_m_s=float("nan")) + BODY], r"frame 0: .*sound speed.*nan m/s"),
        ([pack_header(1, period_us=0) + BODY], r"frame 0: .*found 0 us"),
    ],
)
def test_a_fault_is_reported_in_one_line(tmp_path: Path, frames: list[bytes], message: str) -> None:
    path = write_file(tmp_path / "a.aris", frames)
    with pytest.raises(AsfmError, match=rf"a\.aris.*{message}") as error:
        check_settings(path, read_headers(path))
    assert "\n" not in str(error.value)
