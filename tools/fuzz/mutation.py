"""Mutations of bytes: flips, cuts, repetitions, lines, and numbers and words that readers trip over."""

import re
import struct

import numpy as np

WORDS = (
    *(b"nan", b"inf", b"-1", b"0", b"1e308", b"1e-308", b"9" * 40, b"\0", b"\xff", b"&a", b"*a", b"../x", b'"', b","),
    *(b"\n", b"\r", b"\t", b" ", b"-inf", b"1e400", b"-0.0", b"1_0", b"0x10", b"2147483648", b"true", b"null", b"{}"),
    *(b"[]", b"~", b"\xef\xbb\xbf", b"\xe2\x80\xa8", b"\xed\xa0\x80", "١".encode(), b"1e-9", b"1e9", b"#", b"%s"),
)
"""Values at the ends of types, and characters with a meaning of their own."""
NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
INTEGERS = (0, 1, 2, 127, 128, 255, 256, 32767, 65535, 1 << 20, (1 << 31) - 1, 1 << 31, (1 << 32) - 1, (1 << 63) - 1)
FLOATS = (0.0, -1.0, 1e-300, 1e9, 1e30, 1e300, float("nan"), float("inf"))


def mutate(content: bytes, rng: np.random.Generator) -> bytes:
    """Return the content with one to four random mutations.

    Half of all text keeps its form, so that readers come to its values: a number or a line is changed.
    """
    if _is_text(content) and rng.random() < 0.5:
        word = WORDS[int(rng.integers(len(WORDS)))]
        return _mutate_lines(content, rng) if rng.random() < 0.2 else _replace_number(content, word, rng)
    for _ in range(int(rng.integers(1, 5))):
        content = _mutate_once(content, rng)
    return content


def _is_text(content: bytes) -> bool:
    try:
        return "\0" not in content.decode()
    except UnicodeDecodeError:
        return False


def _mutate_once(content: bytes, rng: np.random.Generator) -> bytes:
    start = int(rng.integers(0, len(content) + 1))
    end = min(len(content), start + int(rng.integers(1, 9)))
    word = WORDS[int(rng.integers(len(WORDS)))]
    match int(rng.integers(9)):
        case 0:
            return content[:start] + rng.bytes(end - start) + content[end:]
        case 1:
            return content[:start] if rng.random() < 0.3 else content[:start] + content[end:]
        case 2:
            return content[:start] + content[start:end] * int(rng.integers(2, 99)) + content[end:]
        case 3:
            return content[:start] + word + content[start:]
        case 4:
            value = _pack_value(rng)
            return content[:start] + value + content[start + len(value) :]
        case 5:
            return _mutate_lines(content, rng)
        case 6:
            block = content[start : start + int(rng.integers(1, 65))]
            place = int(rng.integers(0, len(content) + 1))
            return content[:place] + block + content[place + len(block) * int(rng.integers(2)) :]
        case _:
            return _replace_number(content, word, rng)


def _pack_value(rng: np.random.Generator) -> bytes:
    """Return an integer or a float at an end of its type, in either byte order."""
    order = "<>"[int(rng.integers(2))]
    if rng.random() < 0.3:
        value = FLOATS[int(rng.integers(len(FLOATS)))]
        form = "d" if abs(value) > 1e38 or rng.random() < 0.5 else "f"
        return struct.pack(order + form, value)
    size = (1, 2, 4, 8)[int(rng.integers(4))]
    whole = INTEGERS[int(rng.integers(len(INTEGERS)))] & ((1 << 8 * size) - 1)
    return whole.to_bytes(size, "little" if order == "<" else "big")


def _mutate_lines(content: bytes, rng: np.random.Generator) -> bytes:
    """Remove, repeat or exchange a line."""
    lines = content.split(b"\n")
    first, second = (int(index) for index in rng.integers(0, len(lines), 2))
    match int(rng.integers(3)):
        case 0:
            del lines[first]
        case 1:
            lines.insert(second, lines[first])
        case _:
            lines[first], lines[second] = lines[second], lines[first]
    return b"\n".join(lines)


def _replace_number(content: bytes, word: bytes, rng: np.random.Generator) -> bytes:
    """Replace a number in the text by a word, or by itself at another scale."""
    numbers = list(NUMBER.finditer(content))
    if not numbers:
        return content + word
    found = numbers[int(rng.integers(len(numbers)))]
    if rng.random() < 0.6:
        word = found.group() + (b"e3", b"e-3", b"0", b"e15", b".5", b"00000")[int(rng.integers(6))]
    return content[: found.start()] + word + content[found.end() :]
