"""Message headers of Blueprint Oculus sonars: parsing and validation of simple ping results."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from asfm.errors import AsfmError
from asfm.regular_file import check_file, open_file

OCULUS_ID = 0x4F53
SIMPLE_PING_RESULT = 0x23
LOW_FREQUENCY, HIGH_FREQUENCY = 1, 2
FREQUENCY_NAMES = {LOW_FREQUENCY: "low frequency", HIGH_FREQUENCY: "high frequency"}
ROW_GAINS_FLAG = 0x04
MESSAGE_HEADER_BYTES = 16
MAX_RANGES, MAX_BEAMS = 100_000, 10_000
"""The sonar sends some thousand by 512 at most, so larger numbers are a damaged header."""
SAMPLE_TYPES: dict[int, np.dtype[Any]] = {0: np.dtype("u1"), 1: np.dtype("<u2"), 3: np.dtype("<u4")}
"""Type of a sample by the header's data_size."""
MIN_RANGE_STEP_M, MAX_RANGE_STEP_M = 1e-5, 10
MIN_GAMMA_CODE = 13
"""Sonars send 127; a twentieth of 255 already takes a grey value to its twentieth power."""
MAX_BEARING_CENTIDEG = 9000


def _layout(size: int, fields: dict[str, tuple[str, int]]) -> np.dtype[Any]:
    """Return the dtype of a packed header from the type and the byte offset of each field."""
    formats, offsets = zip(*fields.values(), strict=True)
    return np.dtype({"names": list(fields), "formats": list(formats), "offsets": list(offsets), "itemsize": size})


FIRE_FIELDS = {"master_mode": ("u1", 16), "rate_code": ("u1", 17), "gamma_code": ("u1", 19), "flags": ("u1", 20)}
HEADERS = {
    1: _layout(
        122,
        FIRE_FIELDS
        | {"start_time": ("<u4", 93), "data_size": ("u1", 97), "range_step_m": ("<f8", 98), "ranges": ("<u2", 106)}
        | {"beams": ("<u2", 108), "image_offset": ("<u4", 110), "image_size": ("<u4", 114)},
    ),
    2: _layout(
        202,
        FIRE_FIELDS
        | {"start_time": ("<f8", 153), "data_size": ("u1", 161), "range_step_m": ("<f8", 162), "ranges": ("<u2", 170)}
        | {"beams": ("<u2", 172), "image_offset": ("<u4", 190), "image_size": ("<u4", 194)},
    ),
}
"""Header of a ping by message version, from the start of its message; the table of bearings follows it."""


@dataclass(frozen=True)
class Ping:
    """Header of one ping, and the location of its image in the file."""

    version: int
    master_mode: int
    rate_code: int
    start_time_s: float
    """NaN in version 1, whose clock has no reliable unit."""
    gamma: float
    """Exponent: samples are amplitude ** gamma."""
    range_step_m: float
    shape: tuple[int, int]
    """(ranges, beams)"""
    sample_type: np.dtype[Any]
    has_gains: bool
    """Whether a 32-bit gain precedes the samples of each row."""
    bearings_deg: tuple[float, ...]
    """As in the file: increasing, positive to starboard."""
    image_start: int
    """Byte offset in the file."""

    @property
    def frequency_name(self) -> str:
        """Return the name of the frequency mode."""
        return FREQUENCY_NAMES.get(self.master_mode, f"mode {self.master_mode}")

    @property
    def row_type(self) -> np.dtype[Any]:
        """Return the dtype of one row of the image."""
        samples = ("samples", self.sample_type, (self.shape[1],))
        return np.dtype([("gain", "<u4"), samples] if self.has_gains else [samples])

    @property
    def image_bytes(self) -> int:
        """Return the size of the image in bytes, gains included."""
        return self.shape[0] * self.row_type.itemsize


def is_message(head: bytes) -> bool:
    """Return whether bytes begin like an Oculus message; the zero byte in the message number excludes text files."""
    return len(head) >= 8 and int.from_bytes(head[:2], "little") == OCULUS_ID and head[6] > 0 and head[7] == 0


def find_pings(path: Path) -> tuple[Ping, ...]:
    """Read the headers of all pings in a file of messages.

    Args:
        path: the file.

    Returns:
        The pings in the order of the file; other messages are skipped.

    Raises:
        AsfmError: the file is cut off, holds other bytes between messages, holds no ping, or a header is damaged.
    """
    size = check_file(path, "an Oculus recording")
    pings: list[Ping] = []
    start = 0
    with open_file(path, "an Oculus recording") as file:
        while start < size:
            head = _read_bytes(file, start, MESSAGE_HEADER_BYTES)
            if len(head) == MESSAGE_HEADER_BYTES and not is_message(head):
                raise AsfmError(
                    f"{path}, byte {start}: expected an Oculus message, found other bytes: copy the file again"
                    f"{_suggest_truncation(len(pings), start)}"
                )
            end = start + MESSAGE_HEADER_BYTES + int.from_bytes(head[10:14], "little")
            if len(head) < MESSAGE_HEADER_BYTES or end > size:
                raise AsfmError(
                    f"{path}, byte {start}: expected a message of {max(end - start, MESSAGE_HEADER_BYTES)} bytes, "
                    f"found {size - start}: the file is cut off; copy it again{_suggest_truncation(len(pings), start)}"
                )
            if int.from_bytes(head[6:8], "little") == SIMPLE_PING_RESULT:
                pings.append(_read_ping(file, f"{path}, frame {len(pings)}", start, end))
            start = end
    if not pings:
        raise AsfmError(f"{path}: expected at least one simple ping result, found {size} bytes of other messages")
    return tuple(pings)


def _read_ping(file: BinaryIO, where: str, start: int, end: int) -> Ping:
    """Read and validate the header of the ping whose message lies in the bytes ``start`` to ``end`` of the file."""
    version = 2 if int.from_bytes(_read_bytes(file, start + 8, 2), "little") == 2 else 1
    layout = HEADERS[version]
    if end - start < layout.itemsize:
        raise AsfmError(f"{where}: expected a message of {layout.itemsize} bytes or more, found {end - start}")
    header = np.frombuffer(_read_bytes(file, start, layout.itemsize), dtype=layout)[0]
    ranges, beams, step_m = int(header["ranges"]), int(header["beams"]), float(header["range_step_m"])
    if not (2 <= ranges <= MAX_RANGES and 2 <= beams <= MAX_BEAMS):
        raise AsfmError(f"{where}: expected at least 2 ranges x 2 beams, found {ranges} x {beams}")
    if header["data_size"] not in SAMPLE_TYPES:
        raise AsfmError(f"{where}: expected samples of 8, 16 or 32 bits (0, 1, 3), found {header['data_size']}")
    if 0 < header["gamma_code"] < MIN_GAMMA_CODE:
        found = int(header["gamma_code"])
        raise AsfmError(f"{where}: expected a gamma of {MIN_GAMMA_CODE}..255 (of 255), or 0 for none, found {found}")
    if not MIN_RANGE_STEP_M < step_m < MAX_RANGE_STEP_M:
        raise AsfmError(f"{where}: expected a range resolution of 0.00001..10 m, found {step_m} m")
    ping = Ping(
        version=version,
        master_mode=int(header["master_mode"]),
        rate_code=int(header["rate_code"]),
        start_time_s=float(header["start_time"]) if version == 2 else float("nan"),
        gamma=int(header["gamma_code"]) / 255 or 1.0,  # 0 and 255 both mean no gamma
        range_step_m=step_m,
        shape=(ranges, beams),
        sample_type=SAMPLE_TYPES[int(header["data_size"])],
        has_gains=bool(header["flags"] & ROW_GAINS_FLAG),
        bearings_deg=_read_bearings(file, where, start + layout.itemsize, beams),
        image_start=start + int(header["image_offset"]),
    )
    _check_image(where, ping, int(header["image_size"]), start + layout.itemsize + 2 * beams, end)
    return ping


def _read_bearings(file: BinaryIO, where: str, start: int, beams: int) -> tuple[float, ...]:
    """Read the table of bearings from hundredths of a degree, in degrees."""
    table = np.frombuffer(_read_bytes(file, start, 2 * beams).ljust(2 * beams, b"\0"), dtype="<i2").astype(np.int64)
    if not (np.diff(table) > 0).all() or np.abs(table).max() >= MAX_BEARING_CENTIDEG:
        raise AsfmError(
            f"{where}: expected {beams} bearings that increase within -90..90 degrees, "
            f"found {table[0] / 100:g}..{table[-1] / 100:g} degrees, not increasing or not within"
        )
    return tuple((table / 100).tolist())


def _check_image(where: str, ping: Ping, image_size: int, start: int, end: int) -> None:
    """Check that the image has the size that its header implies, and lies in its message after the bearings."""
    if image_size != ping.image_bytes:
        gains = "with" if ping.has_gains else "without"
        raise AsfmError(
            f"{where}: expected an image of {ping.image_bytes} bytes ({ping.shape[0]} ranges x {ping.shape[1]} beams "
            f"of {8 * ping.sample_type.itemsize} bits, {gains} row gains), found {image_size}"
        )
    if not start <= ping.image_start <= end - image_size:
        raise AsfmError(
            f"{where}: expected {image_size} bytes of image within the message (bytes {start} to {end} of the file), "
            f"found them from byte {ping.image_start} on"
        )


def _suggest_truncation(complete: int, start: int) -> str:
    return f", or truncate it to {start} bytes to use the {complete} complete pings before" if complete else ""


def _read_bytes(file: BinaryIO, start: int, count: int) -> bytes:
    file.seek(start)
    return file.read(count)
