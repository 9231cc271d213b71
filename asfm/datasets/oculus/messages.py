"""The messages of a Blueprint Oculus: where each ping's image lies in a file, and what its header says."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from asfm.errors import AsfmError

OCULUS_ID = 0x4F53
SIMPLE_PING_RESULT = 0x23
LOW_FREQUENCY, HIGH_FREQUENCY = 1, 2
FREQUENCY_NAMES = {LOW_FREQUENCY: "low frequency", HIGH_FREQUENCY: "high frequency"}
ROW_GAINS = 0x04
MESSAGE_BYTES = 16
MOST_RANGES, MOST_BEAMS = 100_000, 10_000
"""Far beyond what the sonar sends (some thousand by 512): larger numbers are a damaged header."""
SAMPLE_TYPES: dict[int, np.dtype[Any]] = {0: np.dtype("u1"), 1: np.dtype("<u2"), 3: np.dtype("<u4")}


def _layout(size: int, fields: dict[str, tuple[str, int]]) -> np.dtype[Any]:
    """Describe packed bytes by the type and the place of each field."""
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
"""A ping's header by version, from the start of its message; the table of bearings follows."""


@dataclass(frozen=True)
class Ping:
    """What the header of one ping says, and where its image lies in the file."""

    version: int
    master_mode: int
    rate_code: int
    start_time_s: float
    """NaN in version 1, whose clock has no trustworthy unit."""
    gamma: float
    """The samples are amplitudes to this power."""
    range_step_m: float
    shape: tuple[int, int]
    """(ranges, beams)"""
    sample_type: np.dtype[Any]
    has_gains: bool
    """A 32-bit gain stands before each row's samples."""
    bearings_deg: tuple[float, ...]
    """As in the file: rising, positive to starboard."""
    image_at: int
    """Byte of the file."""

    @property
    def frequency_name(self) -> str:
        """The frequency in words."""
        return FREQUENCY_NAMES.get(self.master_mode, f"mode {self.master_mode}")

    @property
    def row_type(self) -> np.dtype[Any]:
        """One row of the image."""
        samples = ("samples", self.sample_type, (self.shape[1],))
        return np.dtype([("gain", "<u4"), samples] if self.has_gains else [samples])

    @property
    def image_bytes(self) -> int:
        """Size of the image, the gains included."""
        return self.shape[0] * self.row_type.itemsize


def is_message(start: bytes) -> bool:
    """Tell whether bytes start as a message does; text never has the zero in the message's number."""
    return len(start) >= 8 and int.from_bytes(start[:2], "little") == OCULUS_ID and start[6] > 0 and start[7] == 0


def find_pings(path: Path) -> tuple[Ping, ...]:
    """Read the header of every ping in a file of messages.

    Raises:
        AsfmError: the file is cut off, holds other bytes between messages, or no ping, or a ping's header is damaged.
    """
    size = path.stat().st_size
    pings: list[Ping] = []
    at = 0
    with path.open("rb") as file:
        while at < size:
            head = _read(file, at, MESSAGE_BYTES)
            if len(head) == MESSAGE_BYTES and not is_message(head):
                raise AsfmError(
                    f"{path}, byte {at}: expected an Oculus message, found others: copy the file again"
                    f"{_offer(len(pings), at)}"
                )
            end = at + MESSAGE_BYTES + int.from_bytes(head[10:14], "little")
            if len(head) < MESSAGE_BYTES or end > size:
                raise AsfmError(
                    f"{path}, byte {at}: expected a message of {max(end - at, MESSAGE_BYTES)} bytes, found "
                    f"{size - at}: the file is cut off; copy it again{_offer(len(pings), at)}"
                )
            if int.from_bytes(head[6:8], "little") == SIMPLE_PING_RESULT:
                pings.append(_read_ping(file, f"{path}, frame {len(pings)}", at, end))
            at = end
    if not pings:
        raise AsfmError(f"{path}: expected at least one simple ping result, found {size} bytes of other messages")
    return tuple(pings)


def _read_ping(file: BinaryIO, where: str, at: int, end: int) -> Ping:
    """Read and check the header of the ping whose message lies from byte ``at`` to byte ``end``."""
    version = 2 if int.from_bytes(_read(file, at + 8, 2), "little") == 2 else 1
    layout = HEADERS[version]
    if end - at < layout.itemsize:
        raise AsfmError(f"{where}: expected a message of {layout.itemsize} bytes or more, found {end - at}")
    header = np.frombuffer(_read(file, at, layout.itemsize), dtype=layout)[0]
    ranges, beams, step_m = int(header["ranges"]), int(header["beams"]), float(header["range_step_m"])
    if not (2 <= ranges <= MOST_RANGES and 2 <= beams <= MOST_BEAMS):
        raise AsfmError(f"{where}: expected at least 2 ranges x 2 beams, found {ranges} x {beams}")
    if header["data_size"] not in SAMPLE_TYPES:
        raise AsfmError(f"{where}: expected samples of 8, 16 or 32 bits (0, 1, 3), found {header['data_size']}")
    if not 1e-5 < step_m < 10:
        raise AsfmError(f"{where}: expected a range resolution of 0.00001..10 m, found {step_m} m")
    ping = Ping(
        version=version,
        master_mode=int(header["master_mode"]),
        rate_code=int(header["rate_code"]),
        start_time_s=float(header["start_time"]) if version == 2 else float("nan"),
        gamma=int(header["gamma_code"]) / 255 or 1.0,  # 0 means none, as 255 does
        range_step_m=step_m,
        shape=(ranges, beams),
        sample_type=SAMPLE_TYPES[int(header["data_size"])],
        has_gains=bool(header["flags"] & ROW_GAINS),
        bearings_deg=_read_bearings(file, where, at + layout.itemsize, beams),
        image_at=at + int(header["image_offset"]),
    )
    _check_image(where, ping, int(header["image_size"]), at + layout.itemsize + 2 * beams, end)
    return ping


def _read_bearings(file: BinaryIO, where: str, at: int, beams: int) -> tuple[float, ...]:
    table = np.frombuffer(_read(file, at, 2 * beams).ljust(2 * beams, b"\0"), dtype="<i2").astype(np.int64)
    if not (np.diff(table) > 0).all() or np.abs(table).max() >= 9000:
        raise AsfmError(
            f"{where}: expected {beams} bearings that rise within -90..90 degrees, "
            f"found {table[0] / 100:g}..{table[-1] / 100:g} degrees, not all rising or not all within"
        )
    return tuple((table / 100).tolist())


def _check_image(where: str, ping: Ping, image_size: int, first: int, end: int) -> None:
    """Check that the image is as large as its header says and lies in its message, after the bearings."""
    if image_size != ping.image_bytes:
        gains = "with" if ping.has_gains else "without"
        raise AsfmError(
            f"{where}: expected an image of {ping.image_bytes} bytes ({ping.shape[0]} ranges x {ping.shape[1]} beams "
            f"of {8 * ping.sample_type.itemsize} bits, {gains} row gains), found {image_size}"
        )
    if not first <= ping.image_at <= end - image_size:
        raise AsfmError(
            f"{where}: expected {image_size} bytes of image within the message (bytes {first} to {end} of the file), "
            f"found them from byte {ping.image_at} on"
        )


def _offer(whole: int, at: int) -> str:
    return f", or cut it to {at} bytes to use the {whole} whole pings before" if whole else ""


def _read(file: BinaryIO, at: int, count: int) -> bytes:
    file.seek(at)
    return file.read(count)
