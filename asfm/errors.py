"""Exception for faults of the input, the configuration or the command line, and quotations for its message."""

import reprlib
from typing import Any

MAX_QUOTED = 80
"""Characters of the input that a message repeats at most."""
MAX_MESSAGE = 700
"""Characters of a whole message; what is in the middle of a longer one is left out."""
MAX_DIGITS = 30
"""Digits of a whole number that is quoted digit by digit."""


class AsfmError(Exception):
    """An input, a configuration or a command line is at fault.

    The message is one line: what was expected, what was found, where, and what to do. The command line prints it
    and exits with code 2; every other exception is a defect of asfm. Characters that would break the line, or that
    a terminal would obey, are written as escapes.
    """

    def __init__(self, message: str = "") -> None:
        super().__init__(_omit_middle(escape(message)))


def escape(text: str) -> str:
    """Return text on one line, every character that cannot be printed replaced by its escape."""
    if text.isprintable():
        return text
    return "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in text)


def shorten(text: str, length: int = MAX_QUOTED) -> str:
    """Return text on one line of at most ``length`` characters; runs of blanks become one."""
    text = escape(" ".join(text[: 20 * length].split()))
    return text if len(text) <= length else f"{text[: length - 3]}..."


def quote(value: Any) -> str:
    """Return what was found, as Python writes it, in at most :data:`MAX_QUOTED` characters on one line."""
    if isinstance(value, str | bytes):
        return shorten(repr(value[: 2 * MAX_QUOTED]))
    if isinstance(value, int) and not isinstance(value, bool):
        return _quote_integer(value)
    if isinstance(value, float | bool) or value is None:
        return repr(value)
    return shorten(_Quotation().repr(value))


def join_quoted(names: list[str], limit: int = 5) -> str:
    """Return names from an input with commas between them, the first few of many, each shortened."""
    more = f" and {len(names) - limit} more" if len(names) > limit else ""
    return ", ".join(shorten(name, MAX_QUOTED // limit) for name in names[:limit]) + more


def _quote_integer(value: int) -> str:
    if abs(value) < 10**MAX_DIGITS:
        return repr(value)
    return f"a whole number of {value.bit_length()} bits"


class _Quotation(reprlib.Repr):
    """Short form of nested values; time and length do not grow with them."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel, self.maxdict, self.maxstring, self.maxother = 2, 3, 40, 40

    def repr_int(self, x: int, level: int) -> str:
        """Return a whole number; one of any length takes no time."""
        del level
        return _quote_integer(x)


def _omit_middle(message: str) -> str:
    half = MAX_MESSAGE // 2
    return message if len(message) <= MAX_MESSAGE else f"{message[: half - 3]} ... {message[2 - half :]}"
