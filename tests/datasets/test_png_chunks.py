"""PNG chunks: what libpng would print or pass over is refused, and the pixels stay the same."""

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from skimage.io import imsave

from asfm.datasets.images import encode_png, read_grey_png
from asfm.datasets.png_chunks import SIGNATURE, extract_grey_png
from asfm.errors import AsfmError

PIXELS = np.random.default_rng(0).integers(0, 256, (7, 5)).astype(np.uint8)
HEADER = struct.pack(">IIBBBBB", 5, 7, 8, 0, 0, 0, 0)
ROWS = b"".join(b"\0" + row.tobytes() for row in PIXELS)


def chunk(name: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))


def png(*chunks: tuple[bytes, bytes]) -> bytes:
    return SIGNATURE + b"".join(chunk(name, body) for name, body in (*chunks, (b"IEND", b"")))


def plain(rows: bytes = ROWS, header: bytes = HEADER) -> bytes:
    return png((b"IHDR", header), (b"IDAT", zlib.compress(rows)))


def refusal(content: bytes) -> str:
    with pytest.raises(AsfmError) as refused:
        extract_grey_png(Path("x.png"), content)
    return str(refused.value)


def test_pixels_survive_in_any_number_of_chunks_and_beside_other_chunks(tmp_path: Path) -> None:
    data = zlib.compress(ROWS)
    split = [(b"IDAT", data[:9]), (b"IDAT", b""), (b"IDAT", data[9:])]
    others = [(b"tEXt", b"Comment\0\xff"), (b"gAMA", bytes(4)), (b"iCCP", b"damaged"), (b"acTL", bytes(8))]
    path = tmp_path / "x.png"
    path.write_bytes(png((b"IHDR", HEADER), *others, *split))
    assert np.array_equal(read_grey_png(path, PIXELS.shape), PIXELS)
    assert extract_grey_png(path, path.read_bytes()) == plain()


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_images_of_two_encoders_are_accepted(tmp_path: Path, dtype: type) -> None:
    pixels: np.ndarray = PIXELS.astype(dtype) * (1 if dtype is np.uint8 else 257)
    imsave(tmp_path / "skimage.png", pixels, check_contrast=False)
    (tmp_path / "cv2.png").write_bytes(encode_png(pixels))
    for name in ("skimage.png", "cv2.png"):
        assert np.array_equal(read_grey_png(tmp_path / name, pixels.shape), pixels)


@pytest.mark.parametrize(("columns", "rows"), [(1, 1), (5, 7), (8, 8), (3, 1), (1, 4)])
def test_interlaced_images_have_the_rows_of_seven_passes(columns: int, rows: int) -> None:
    """Oracle: the table of Adam7, pixel by pixel."""
    table = np.array([[1, 6, 4, 6, 2, 6, 4, 6], [7] * 8, [5, 6, 5, 6, 5, 6, 5, 6], [7] * 8] * 2)
    table[4] = [3, 6, 4, 6, 3, 6, 4, 6]
    of_pixel = np.tile(table, (2, 2))[:rows, :columns]
    data = b""
    for number in range(1, 8):
        for row in of_pixel:
            data += b"\0" + bytes(int((row == number).sum())) if (row == number).any() else b""
    header = struct.pack(">IIBBBBB", columns, rows, 8, 0, 0, 0, 1)
    content = extract_grey_png(Path("x.png"), plain(data, header))
    decoded = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    assert decoded is not None and decoded.shape == (rows, columns)
    assert "bytes of pixels" in refusal(plain(data + b"\0", header))


def test_damaged_pixels_are_refused_before_libpng_prints_of_them(capfd: pytest.CaptureFixture[str]) -> None:
    damaged = bytearray(zlib.compress(ROWS))
    damaged[-1] ^= 1
    assert "damaged pixels" in refusal(png((b"IHDR", HEADER), (b"IDAT", bytes(damaged))))
    assert "expected 42 bytes of pixels" in refusal(plain(ROWS[:-1])) and "found 43" in refusal(plain(ROWS + b"\0"))
    assert "found 42 or more" in refusal(png((b"IHDR", HEADER), (b"IDAT", zlib.compress(ROWS)[:-4])))
    assert "unknown filter" in refusal(plain(ROWS[:6] + b"\5" + ROWS[7:]))
    assert "found two" in refusal(png((b"IHDR", HEADER), (b"IHDR", HEADER)))
    assert "found 3 bits" in refusal(plain(header=struct.pack(">IIBBBBB", 5, 7, 3, 0, 0, 0, 0)))
    assert "transparent" in refusal(png((b"IHDR", HEADER), (b"tRNS", bytes(2)), (b"IDAT", zlib.compress(ROWS))))
    assert "wrong checksum at byte 8" in refusal(plain().replace(b"IHDR", b"IHDQ"))
    assert "cut off after" in refusal(plain()[:-5])
    assert capfd.readouterr().err == ""


def test_pixels_that_expand_without_end_take_no_memory() -> None:
    bomb = zlib.compress(bytes(1 << 24), 9)
    assert "found 43 or more" in refusal(png((b"IHDR", HEADER), (b"IDAT", bomb)))
