"""Stand-ins for stages, to test that a pipeline runs each of them on what the one before it returned."""

from collections.abc import Callable
from typing import Any

import pytest

Calls = list[tuple[Any, ...]]
"""Arguments of each call; those given by name come last."""


def stub_stages(monkeypatch: pytest.MonkeyPatch, module: str) -> Callable[[str, Any], Calls]:
    """Return a function that replaces a stage of a module of asfm.pipeline and notes the arguments of its calls.

    Its second argument is what the stage returns, or a function of the stage's arguments.
    """

    def stub(name: str, result: Any) -> Calls:
        calls: Calls = []

        def stage(*args: Any, **kwargs: Any) -> Any:
            calls.append((*args, *kwargs.values()))
            return result(*args, *kwargs.values()) if callable(result) else result

        monkeypatch.setattr(f"asfm.pipeline.{module}.{name}", stage)
        return calls

    return stub
