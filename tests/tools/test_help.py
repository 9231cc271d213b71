"""Every tool prints its help."""

import importlib
import sys
from pathlib import Path

import pytest

TOOLS = Path(__file__).resolve().parents[2] / "tools"


def test_every_tool_prints_its_help(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    found = 0
    for path in sorted(TOOLS.rglob("*.py")):
        name = ".".join(path.relative_to(TOOLS.parent).with_suffix("").parts)
        module = importlib.import_module(name)
        if not hasattr(module, "main"):
            continue
        found += 1
        monkeypatch.setattr(sys, "argv", [path.name, "--help"])
        with pytest.raises(SystemExit) as exit_:
            module.main()
        assert exit_.value.code == 0
        assert f"python -m {name.removesuffix('.__main__')} " in capsys.readouterr().out
    assert found == 6
