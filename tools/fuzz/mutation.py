"""Mutations of bytes: flips, cuts, repetitions, and numbers and words that readers trip over."""

import re

import numpy as np

WORDS = (
    b"nan",
    b"inf",
    b"-1",
    b"0",
    b"1e308",
    b"1e-308",
    b"9" * 40,
    b"\0",
    b"\xff",
    b"&a",
    b"*a",
    b"../x",
    b'"',
    b",",
    b"\n",
)
"""Values at the ends of types, and characters with a meaning of their own."""
NUMBER = re.compile(rb"-?\d+(?:\.\d+)?")


def mutate(content: bytes, rng: np.random.Generator) -> bytes:
    """Return the content with one to four random mutations."""
    for _ in range(int(rng.integers(1, 5))):
        content = _mutate_once(content, rng)
    return content


def _mutate_once(content: bytes, rng: np.random.Generator) -> bytes:
    start = int(rng.integers(0, len(content) + 1))
    end = min(len(content), start + int(rng.integers(1, 9)))
    word = WORDS[int(rng.integers(len(WORDS)))]
    numbers = list(NUMBER.finditer(content))
    match int(rng.integers(6)):
        case 0:
            return content[:start] + rng.bytes(end - start) + content[end:]
        case 1:
            return content[:start]
        case 2:
            return content[:start] + content[end:]
        case 3:
            return content[:start] + content[start:end] * int(rng.integers(2, 99)) + content[end:]
        case 4 if numbers:
            found = numbers[int(rng.integers(len(numbers)))]
            return content[: found.start()] + word + content[found.end() :]
        case _:
            return content[:start] + word + content[start:]
