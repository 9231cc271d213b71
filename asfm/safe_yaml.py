"""YAML of plain values: aliases, tags, repeated keys and deep nesting are refused before anything is built."""

from pathlib import Path
from typing import Any

import yaml

from asfm.errors import AsfmError, quote, shorten
from asfm.regular_file import read_text

MAX_BYTES = 4 << 20
MAX_DEPTH = 16
MAX_VALUES = 100_000
MAX_SCALAR = 1000
"""Characters of one value: Python needs time that grows with the square of a number's length."""

_Base: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _Refused(Exception):
    """The text asks for something that is not allowed."""


def read_yaml(path: Path, expected: str) -> Any:
    """Read a YAML file of plain values.

    Args:
        path: the file.
        expected: what it should hold, for messages, such as "the settings".

    Raises:
        AsfmError: it is no regular file, no UTF-8, no YAML, or holds what :func:`parse_yaml` refuses.
    """
    return parse_yaml(read_text(path, expected, MAX_BYTES), f"{path}: cannot read {expected}")


def parse_yaml(text: str, where: str) -> Any:
    """Parse YAML into dictionaries, lists, strings, numbers, booleans and None.

    Args:
        text: the document.
        where: beginning of error messages.

    Raises:
        AsfmError: it is no YAML, or holds an anchor, an alias, a tag, a key twice, more than 16 levels or 100,000
            values.
    """
    try:
        _check_events(text)
        return _UniqueKeyLoader(text).get_single_data()
    except _Refused as refusal:
        raise AsfmError(f"{where}: {refusal}") from None
    except yaml.MarkedYAMLError as error:
        raise AsfmError(f"{where}: {_describe_fault(error)}") from None
    except (yaml.YAMLError, ValueError, OverflowError, RecursionError, TypeError, AttributeError) as error:
        raise AsfmError(f"{where}: {shorten(str(error) or type(error).__name__)}") from None


class _UniqueKeyLoader(_Base):  # type: ignore[misc]
    """Safe loader that refuses a key that is there twice; the last would win without a word."""

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        """Build a dictionary whose keys are all different scalars."""
        seen: set[str] = set()
        for key, _ in node.value:
            line = key.start_mark.line + 1
            if not isinstance(key, yaml.ScalarNode) or key.value == "<<":
                raise _Refused(f"line {line}: expected a name as key, found another value")
            if key.value in seen:
                raise _Refused(f"line {line}: expected each key once, found {quote(key.value)} again")
            seen.add(key.value)
        return super().construct_mapping(node, deep)


def _check_events(text: str) -> None:
    """Check the stream of events, which is read without building anything."""
    depth = count = 0
    for event in yaml.parse(text, Loader=_Base):
        where = "" if event.start_mark is None else f"line {event.start_mark.line + 1}"
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            raise _Refused(f"{where}: expected plain values, found an anchor or alias (& or *): write the value out")
        tag = getattr(event, "tag", None)
        if tag:
            raise _Refused(f"{where}: expected plain values, found the tag {quote(tag)}: remove it")
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        count += isinstance(event, yaml.NodeEvent)
        if depth > MAX_DEPTH or count > MAX_VALUES:
            limit = f"{MAX_DEPTH} levels" if depth > MAX_DEPTH else f"{MAX_VALUES} values"
            raise _Refused(f"{where}: expected {limit} at most, found more")
        if isinstance(event, yaml.ScalarEvent) and len(event.value) > MAX_SCALAR:
            found = f"{len(event.value)} that begin {quote(event.value[:40])}"
            raise _Refused(f"{where}: expected a value of {MAX_SCALAR} characters at most, found {found}")


def _describe_fault(error: yaml.MarkedYAMLError) -> str:
    place = "" if error.problem_mark is None else f"line {error.problem_mark.line + 1}: "
    context = f"{error.context}, " if error.context else ""
    return f"{place}{shorten(f'{context}{error.problem}')}"
