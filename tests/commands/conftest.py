"""Fixtures of the tests of the commands."""

from collections.abc import Callable
from pathlib import Path

import pytest

from asfm.cli import run_command_line
from asfm.commands import run_demo


@pytest.fixture(scope="session")
def demo_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a demo of 6 frames: a simulated sequence and the results of its run.

    It is shared by all tests of the commands, which change copies of it only.
    """
    folder = tmp_path_factory.mktemp("demo")
    run_demo(folder, frames=6)
    return folder


@pytest.fixture
def ask(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Return a function that runs a command line that must succeed, and returns what it printed on stdout."""

    def run(*arguments: str | Path) -> str:
        capsys.readouterr()
        assert run_command_line([str(argument) for argument in arguments]) == 0, capsys.readouterr().err
        return capsys.readouterr().out

    return run
