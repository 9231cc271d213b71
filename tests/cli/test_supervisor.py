"""Supervision: exit codes and one line, however the work ends, and no temporary folder is left."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="processes are not forked")
CODE = """
import os, resource, signal, sys, time
from pathlib import Path
from asfm.atomic_folder import FolderKind, atomic_folder
from asfm.cli import supervisor
supervisor.ORDERLY_END_S = 1
def work():
    with atomic_folder(Path(sys.argv[1]), FolderKind("x", (), ()), False) as folder:
        print("ready", flush=True)
        WORK
    return 0
sys.exit(supervisor.supervise(work))
"""
DEAF = "signal.pthread_sigmask(signal.SIG_BLOCK, [1, 2, 15]); time.sleep(60)"
LIMIT = "resource.setrlimit(resource.RLIMIT_AS, (1 << 40, 1 << 40)); "


def start(tmp_path: Path, work: str, before: str = "") -> "subprocess.Popen[str]":
    command = [sys.executable, "-c", before + CODE.replace("WORK", work), str(tmp_path / "out")]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None and process.stdout.readline() == "ready\n"
    return process


@pytest.mark.parametrize(
    ("work", "before", "code", "words"),
    [
        ("pass", "", 0, ""),
        ("os._exit(1)", "import resource; " + LIMIT, 2, "not enough memory"),
        ("os.abort()", "import resource; " + LIMIT, 2, "not enough memory"),
        ("os.abort()", "", 1, "a library ended the work (SIGABRT)"),
        ("os.kill(os.getpid(), signal.SIGKILL)", "", 2, "not enough memory"),
    ],
)
def test_sudden_ends_are_one_line(tmp_path: Path, work: str, before: str, code: int, words: str) -> None:
    _, err = (process := start(tmp_path, work, before)).communicate(timeout=30)
    assert process.returncode == code and words in err and err.count("\n") == bool(words), err
    assert [path.name for path in tmp_path.iterdir()] == ([] if code else ["out"])


def test_a_watchdog_of_the_caller_does_not_keep_the_work_from_ending(tmp_path: Path) -> None:
    """A fork does not copy its thread, and the end of an interpreter would wait for it."""
    watchdog = "import faulthandler; faulthandler.dump_traceback_later(100)\n"
    process = start(tmp_path, "time.sleep(0.5); print('the last words')", watchdog)
    out, err = process.communicate(timeout=30)
    assert (process.returncode, out, err) == (0, "the last words\n", "")


@pytest.mark.parametrize("sent", ["SIGINT", "SIGTERM", "SIGHUP"])
@pytest.mark.parametrize("times", [1, 2])
def test_work_that_is_deaf_to_signals_is_ended(tmp_path: Path, sent: str, times: int) -> None:
    process = start(tmp_path, DEAF)
    number = getattr(signal, sent)
    for _ in range(times):
        process.send_signal(number)
        time.sleep(0.1)
    _, err = process.communicate(timeout=30)
    assert process.returncode == 128 + number
    assert err == "asfm: interrupted; nothing half-written was left\n"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux ends children with their parent")
def test_the_work_dies_with_its_parent(tmp_path: Path) -> None:
    process = start(tmp_path, "time.sleep(60)")
    process.kill()
    process.communicate(timeout=30)  # the child holds the pipes until it is dead
    (left,) = tmp_path.iterdir()
    assert left.suffix == ".partial"
