"""Error messages: one line of bounded length, whatever the input holds."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from asfm.errors import MAX_MESSAGE, MAX_QUOTED, AsfmError, join_quoted, quote, shorten


@given(st.text())
def test_a_message_is_one_line_that_can_be_printed(text: str) -> None:
    message = str(AsfmError(text))
    assert message.isprintable() and len(message) <= MAX_MESSAGE


def test_the_ends_of_a_long_message_are_kept() -> None:
    message = str(AsfmError("begin" + "x" * 10**6 + "end"))
    assert message.startswith("begin") and message.endswith("end") and len(message) <= MAX_MESSAGE


@pytest.mark.parametrize(
    "value",
    [
        "x" * 10**6,
        "\x1b[2J\n" * 1000,
        b"\0" * 10**6,
        10**10000,
        [10**10000] * 10**5,
        {str(index): ["y" * 1000] * 100 for index in range(10**5)},
        [[[[[[[1]]]]]]],
        1e308,
        None,
        True,
    ],
    ids=range(10),
)
def test_quotations_are_short_and_on_one_line(value: Any) -> None:
    assert len(quote(value)) <= MAX_QUOTED and quote(value).isprintable()


def test_short_values_are_quoted_as_they_are() -> None:
    assert [quote(value) for value in ("a", 12, 0.5, [1, "b"])] == ["'a'", "12", "0.5", "[1, 'b']"]
    assert shorten("a  b\n c") == "a b c"
    assert join_quoted(["a", "b"]) == "a, b" and len(join_quoted(["x" * 1000] * 1000)) < 2 * MAX_QUOTED
