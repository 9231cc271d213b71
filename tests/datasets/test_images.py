"""Grey PNG images: exact round trips, and no damaged file is decoded."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from asfm.datasets.images import Bits, encode_png, quantise, read_grey_png, read_png_shape, scale_to_unit
from asfm.errors import AsfmError

SHAPE = (7, 5)


def make_pixels(bits: Bits) -> np.ndarray:
    largest = 2**bits - 1
    return np.random.default_rng(bits).integers(0, largest + 1, SHAPE).astype(np.uint8 if bits == 8 else np.uint16)


@pytest.mark.parametrize("bits", [8, 16])
def test_every_grey_value_survives_scaling_and_quantisation(bits: Bits) -> None:
    values = np.arange(2**bits).astype(np.uint8 if bits == 8 else np.uint16)
    unit = scale_to_unit(values)
    assert unit.dtype == np.float32 and (unit[0], unit[-1]) == (0, 1)
    found = quantise(unit, bits)
    assert found.dtype == values.dtype
    np.testing.assert_array_equal(found, values)


@pytest.mark.parametrize("bits", [8, 16])
def test_an_encoded_image_is_decoded_to_the_same_pixels(tmp_path: Path, bits: Bits) -> None:
    pixels, path = make_pixels(bits), tmp_path / "a.png"
    path.write_bytes(encode_png(pixels))
    assert read_png_shape(path) == SHAPE
    found = read_grey_png(path, SHAPE)
    assert found.dtype == pixels.dtype
    np.testing.assert_array_equal(found, pixels)
    np.testing.assert_array_equal(cv2.imread(str(path), cv2.IMREAD_UNCHANGED), pixels)


def test_a_file_cut_off_anywhere_is_refused(tmp_path: Path) -> None:
    content, path = encode_png(make_pixels(8)), tmp_path / "a.png"
    for size in range(len(content)):
        path.write_bytes(content[:size])
        with pytest.raises(AsfmError, match=r"a\.png: expected a"):
            read_grey_png(path, SHAPE)


def test_a_byte_changed_anywhere_is_noticed(tmp_path: Path) -> None:
    content, path = encode_png(make_pixels(8)), tmp_path / "a.png"
    for position in range(len(content)):
        damaged = bytearray(content)
        damaged[position] ^= 0x10
        path.write_bytes(damaged)
        with pytest.raises(AsfmError, match=r"a\.png: expected"):
            read_grey_png(path, SHAPE)


@pytest.mark.parametrize(("channels", "name"), [(3, "RGB"), (4, "RGB with alpha")])
def test_colours_are_refused_by_name(tmp_path: Path, channels: int, name: str) -> None:
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), np.zeros((*SHAPE, channels), np.uint8))
    for read in (read_png_shape, lambda file: read_grey_png(file, SHAPE)):
        with pytest.raises(AsfmError, match=rf"a\.png: expected a grey PNG .*, found {name}: convert"):
            read(path)


def test_another_size_is_refused_with_both_sizes(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(encode_png(make_pixels(8)))
    with pytest.raises(AsfmError, match=r"expected 5 x 7 pixels \(ranges x beams\).*found 7 x 5"):
        read_grey_png(path, (5, 7))


def test_a_missing_file_and_another_format_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.jpg").write_bytes(b"\xff\xd8\xff\xe0" + bytes(99))
    for name, message in (("none.png", "expected a grey PNG image, found none"), ("a.jpg", "found a JPEG image")):
        for read in (read_png_shape, lambda file: read_grey_png(file, SHAPE)):
            with pytest.raises(AsfmError, match=message):
                read(tmp_path / name)
