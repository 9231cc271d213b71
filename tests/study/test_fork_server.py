"""Fork server: it loads the libraries of the workers, with one thread, and lets this process's variables be."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from asfm.cli import run_command_line
from asfm.study.fork_server import THREAD_VARIABLES, limit_threads
from tests.study.conftest import ROOT

SCRIPT = """
import signal, sys, time
from asfm.study.fork_server import get_worker_context, start_fork_server

if __name__ == "__main__":
    start_fork_server()
    assert not {"numpy", "pyarrow", "asfm.study.cell_run"} & set(sys.modules), "it starts before all that"
    assert signal.pthread_sigmask(signal.SIG_BLOCK, ()) == set()
    pipe, other = get_worker_context().Pipe()
    code = "import sys; names = {'pyarrow.json', 'asfm.study.cell_run', 'pandas'} & set(sys.modules)"
    process = get_worker_context().Process(target=exec, args=(code + "; pipe.send(names)", {"pipe": other}))
    process.start()
    print(sorted(pipe.recv()))
    process.join()
"""


def test_threads_are_limited_for_new_processes_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    with limit_threads():
        assert {os.environ[name] for name in THREAD_VARIABLES} == {"1"}
    assert os.environ["OMP_NUM_THREADS"] == "7" and "MKL_NUM_THREADS" not in os.environ


@pytest.mark.skipif(sys.platform == "win32", reason="no fork server")
def test_workers_find_their_libraries_loaded() -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.stdout == "['asfm.study.cell_run', 'pyarrow.json']\n", done.stderr


def test_the_command_line_starts_it_for_the_processes_of_this_machine_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[bool] = []
    monkeypatch.setattr("asfm.study.fork_server.start_fork_server", lambda: started.append(True))
    path = tmp_path / "study.yaml"
    command = ["study", str(path), "--output", str(tmp_path / "out")]
    assert run_command_line(command) == 2 and not started, "there is no such study"
    path.write_text("colour: blue\n")
    assert run_command_line([*command, "--scheduler", "nowhere"]) == 2 and not started
    assert run_command_line([*command, "--jobs", "2"]) == 2 and started == [True]
