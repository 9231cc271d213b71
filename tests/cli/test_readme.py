"""The commands of the README parse."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer

from asfm.cli.app import app

ROOT = Path(__file__).resolve().parents[2]


def readme_commands() -> Iterator[str]:
    """Yield every call of asfm in a code block of the README, with continued lines joined."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    for block in re.findall(r"^```[^\n]*\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL):
        for line in block.replace("\\\n", " ").splitlines():
            program, _, arguments = line.strip().removeprefix("$ ").partition(" ")
            if Path(program).name == "asfm":
                yield shlex.join(shlex.split(arguments, comments=True))


def parse(line: str) -> None:
    """Parse a command line as asfm does, without running it."""
    group: Any = typer.main.get_command(app)
    name, *arguments = shlex.split(line) or ["--help"]
    if name.startswith("-"):
        assert name in ("--help", "--version", "-h")
        return
    assert name in group.commands, f"asfm {name} does not exist"
    group.commands[name].make_context(f"asfm {name}", arguments)


def test_every_command_of_the_readme_parses() -> None:
    commands = list(readme_commands())
    assert commands, "the README shows no command"
    for line in commands:
        parse(line)


@pytest.mark.parametrize("line", ["studies x.yaml", "run", "run sequence --output out --colour", "demo --frames many"])
def test_invalid_command_lines_do_not_parse(line: str) -> None:
    with pytest.raises(Exception, match=r"does not exist|Missing|No such option|valid integer"):
        parse(line)


def test_makefile_and_ci_run_the_tests() -> None:
    makefile = (ROOT / "Makefile").read_text()
    assert re.search(r"^demo:", makefile, re.MULTILINE) and re.search(r"^test:", makefile, re.MULTILINE)
    assert "make test" in (ROOT / ".ci" / "run").read_text()
    assert (ROOT / ".ci" / "run").stat().st_mode & 0o111
