"""JSON of bounded size and depth: repeated keys and numbers without end are refused."""

import json
import re
from collections import Counter
from pathlib import Path
from typing import Any

from asfm.errors import AsfmError, quote, shorten
from asfm.regular_file import read_text

MAX_BYTES = 16 << 20
MAX_DEPTH = 40
MAX_DIGITS = 30
"""Python needs time that grows with the square of a whole number's length."""
TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|[\[\]{}]', re.DOTALL)
"""A string, or a bracket outside of strings."""


def read_json(path: Path, expected: str) -> Any:
    """Read a JSON file.

    Args:
        path: the file.
        expected: what it should hold, for messages, such as "a HoloOcean scenario".

    Raises:
        AsfmError: it is no regular file, no UTF-8, no JSON, nested too deep, or holds a key twice or a whole number of
            more than 30 digits.
    """
    text = read_text(path, expected, MAX_BYTES)
    try:
        _check_depth(text)
        return json.loads(text, parse_int=_parse_int, object_pairs_hook=_unique)
    except (ValueError, RecursionError) as error:
        raise AsfmError(f"{path}: cannot read {expected}: {shorten(str(error), 160)}") from None


def _check_depth(text: str) -> None:
    """Check the nesting by counting brackets outside of strings."""
    depth = 0
    for token in TOKEN.finditer(text):
        if token.group() in "[{":
            depth += 1
            if depth > MAX_DEPTH:
                raise ValueError(f"expected {MAX_DEPTH} levels of brackets at most, found more")
        elif token.group() in "]}":
            depth -= 1


def _parse_int(text: str) -> int:
    if len(text) > MAX_DIGITS:
        raise ValueError(f"expected numbers of {MAX_DIGITS} digits at most, found {len(text)} digits")
    return int(text)


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        twice = Counter(name for name, _ in pairs).most_common(1)[0][0]
        raise ValueError(f"expected each key once, found {quote(twice)} again")
    return found
