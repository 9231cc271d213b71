"""Signals: the first is raised, further ones do not disturb, and what was ignored stays ignored."""

import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="sends POSIX signals")
CODE = """
import os, signal, sys
from asfm.cli.signals import Stopped, raise_at_first_signal
number = getattr(signal, sys.argv[1])
signal.signal(number, signal.SIG_IGN if sys.argv[2] == "ignored" else signal.SIG_DFL)
raise_at_first_signal()
try:
    os.kill(os.getpid(), number)
    print("went on")
except KeyboardInterrupt as error:
    os.kill(os.getpid(), number)
    print(error.exit_code)
"""


@pytest.mark.parametrize(("name", "code"), [("SIGINT", 130), ("SIGTERM", 143), ("SIGHUP", 129)])
def test_first_signal_is_raised_unless_ignored(name: str, code: int) -> None:
    for before, expected in (("default", f"{code}\n"), ("ignored", "went on\n")):
        command = [sys.executable, "-c", CODE, name, before]
        assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == expected
