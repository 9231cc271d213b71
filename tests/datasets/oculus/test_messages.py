"""Message headers of Oculus recordings, against messages packed field by field."""

import math
from pathlib import Path

import numpy as np
import pytest

from asfm.datasets.oculus.messages import find_pings, is_message
from asfm.errors import AsfmError
from tests.datasets.oculus_files import BEAMS, BEARINGS, RANGES, STEP_M, pack_message, pack_ping

GOOD = pack_ping()


def write_messages(folder: Path, *messages: bytes) -> Path:
    (folder / "a.raw").write_bytes(b"".join(messages))
    return folder / "a.raw"


@pytest.mark.parametrize("version", [1, 2])
def test_a_ping_has_the_fields_of_its_header(tmp_path: Path, version: int) -> None:
    image = np.arange(RANGES * BEAMS).reshape(RANGES, BEAMS)
    gains = np.arange(1, RANGES + 1)
    message = pack_ping(image, version, data_size=1, gains=gains, mode=1, rate=4, start=12.0, gamma=51)
    status = pack_message(b"whatever", number=0x80)
    first, second = find_pings(write_messages(tmp_path, status, message, status, message))
    assert (first.version, first.master_mode, first.rate_code) == (version, 1, 4)
    assert first.frequency_name == "low frequency"
    assert first.start_time_s == 12.0 if version == 2 else math.isnan(first.start_time_s)
    assert (first.gamma, first.range_step_m, first.shape) == (0.2, STEP_M, (RANGES, BEAMS))
    assert first.sample_type == np.uint16 and first.has_gains
    assert first.bearings_deg == tuple(bearing / 100 for bearing in BEARINGS)
    assert first.image_bytes == RANGES * (4 + 2 * BEAMS)
    assert second.image_start - first.image_start == len(message) + len(status)


def test_the_image_starts_where_the_header_says(tmp_path: Path) -> None:
    image = np.arange(RANGES * BEAMS, dtype=np.uint8).reshape(RANGES, BEAMS)
    path = write_messages(tmp_path, GOOD, pack_ping(image))
    _, ping = find_pings(path)
    content = path.read_bytes()[ping.image_start : ping.image_start + ping.image_bytes]
    rows = np.frombuffer(content, dtype=ping.row_type)
    np.testing.assert_array_equal(rows["samples"], image)


def test_an_unlisted_frequency_mode_has_its_number_as_name(tmp_path: Path) -> None:
    (ping,) = find_pings(write_messages(tmp_path, pack_ping(mode=9)))
    assert ping.frequency_name == "mode 9"


@pytest.mark.parametrize("head", [b"", GOOD[:7], b"SONAR LO", b"SO\0\0\0\0\0\0"])
def test_text_and_short_bytes_are_no_message(head: bytes) -> None:
    assert is_message(GOOD) and is_message(GOOD[:8])
    assert not is_message(head)


@pytest.mark.parametrize(
    ("messages", "message"),
    [
        ((GOOD, GOOD[:-3]), r"byte \d+: expected a message of \d+ bytes, found \d+: .*cut off.*the 1 complete pings"),
        ((GOOD[:100],), r"byte 0: expected a message of .*found 100: the file is cut off; copy it again$"),
        ((GOOD, GOOD[:9]), r"expected a message of 16 bytes, found 9"),
        (
            (GOOD, b"\0" * 40),
            rf"byte {len(GOOD)}: expected an Oculus message, found other bytes.*truncate it to {len(GOOD)} ",
        ),
        ((pack_message(b"status", 0x80),), r"expected at least one simple ping result, found 22 bytes"),
        ((pack_message(b"short"),), r"frame 0: expected a message of 122 bytes or more, found 21"),
        ((pack_ping(beams=0),), r"frame 0: expected at least 2 ranges x 2 beams, found 6 x 0"),
        ((pack_ping(np.zeros((0, BEAMS))),), r"frame 0: .*found 0 x 5"),
        ((pack_ping(data_size=2),), r"frame 0: expected samples of 8, 16 or 32 bits \(0, 1, 3\), found 2"),
        ((pack_ping(step_m=math.nan),), r"frame 0: expected a range resolution .* found nan m"),
        ((pack_ping(step_m=0.0),), r"frame 0: expected a range resolution .* found 0\.0 m"),
        ((pack_ping(bearings=BEARINGS[::-1]),), r"frame 0: expected 5 bearings that increase"),
        ((pack_ping(bearings=(*BEARINGS[:-1], 9500)),), r"frame 0: expected 5 bearings that increase within -90\.\.90"),
        ((pack_ping(beams=4),), r"frame 0: expected an image of 24 bytes \(6 ranges x 4 beams of 8 bits.*found 30"),
        ((pack_ping(flags=4),), r"frame 0: expected an image of 54 bytes .*with row gains\), found 30"),
        ((pack_ping(image_shift=1),), r"frame 0: expected 30 bytes of image within the message"),
        ((pack_ping(image_shift=-20),), r"frame 0: expected 30 bytes of image within the message"),
    ],
)
def test_a_fault_is_reported_in_one_line(tmp_path: Path, messages: tuple[bytes, ...], message: str) -> None:
    with pytest.raises(AsfmError, match=rf"a\.raw.*{message}") as error:
        find_pings(write_messages(tmp_path, *messages))
    assert "\n" not in str(error.value)


def test_a_file_cut_off_anywhere_is_refused(tmp_path: Path) -> None:
    content = GOOD + GOOD
    for size in range(1, len(content)):
        path = write_messages(tmp_path, content[:size])
        if size == len(GOOD):
            assert len(find_pings(path)) == 1
        else:
            with pytest.raises(AsfmError, match="cut off"):
                find_pings(path)
