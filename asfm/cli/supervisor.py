"""Supervision of the process that does the work: it ends in time, in one line, and leaves nothing unfinished."""

import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

from asfm import __version__, atomic_folder
from asfm.cli.memory import has_memory_limit
from asfm.cli.signals import catch_signals, ignore_signals, raise_at_first_signal
from asfm.cli.terminal import print_error, silence_libraries

ORDERLY_END_S = 4
"""Longest time from a signal to the end of the work."""
EXIT_DEFECT, EXIT_BAD_INPUT = 1, 2
FOLDER, CODE = b"folder ", b"code "
"""Beginnings of what the child tells its parent: a temporary folder, before it is made, and the exit code at the end.

Without an exit code something else has ended the child, even where its status looks like an exit code of asfm.
"""


def supervise(work: Callable[[], int]) -> int:
    """Do work in a child process and wait for it; on systems without fork, do it here.

    A library may end the process (no memory) or work for long without looking at signals (an adjustment): no code of
    the same process can then remove unfinished folders or say what happened. The first SIGINT, SIGTERM or SIGHUP asks
    the child to end; it is killed after ORDERLY_END_S, or at a second signal. A child whose parent was killed dies.

    Args:
        work: returns an exit code, also at KeyboardInterrupt.

    Returns:
        The exit code of the work.
    """
    source, sink = os.pipe()
    parent = os.getpid()
    try:
        child = os.fork()
    except (AttributeError, OSError):
        raise_at_first_signal()
        return work()
    if child == 0:
        os.close(source)
        _work_under_supervision(work, sink, parent)
    os.close(sink)
    received = _forward_signals(child)
    status = _wait(child)
    if received:
        ignore_signals()  # the work has ended: a later signal must not change the exit code
    folders, code = _read_told(source)
    for folder in folders:
        atomic_folder.remove_partial(folder)
    return _explain(status, received) if code is None else code


def _work_under_supervision(work: Callable[[], int], sink: int, parent: int) -> NoReturn:
    """Do the work as the child, and tell the parent of temporary folders and of the exit code."""
    _die_with_parent(parent)
    raise_at_first_signal()
    if has_memory_limit():
        silence_libraries()  # which print pages where there is no memory; the parent says it in one line

    def tell(message: bytes) -> None:
        os.write(sink, message + b"\0")

    atomic_folder.announce = lambda folder: tell(FOLDER + os.fsencode(folder))
    try:
        code = work()
    except KeyboardInterrupt:  # before or after the command itself; the parent prints the line
        os._exit(EXIT_BAD_INPUT)
    tell(CODE + str(code).encode())
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError, AttributeError):  # closed, or the disk is full: that was said already
            stream.flush()
    os._exit(code)  # the end of the interpreter could wait for threads of the caller, which a fork does not copy


def _forward_signals(child: int) -> list[int]:
    """Pass the first signal on to the child, and kill it at a second one or after ORDERLY_END_S.

    Returns:
        The signals received, which grows.
    """
    received: list[int] = []

    def kill() -> None:
        try:
            os.kill(child, signal.SIGKILL)
        except ProcessLookupError:
            return

    def forward(number: int) -> None:
        received.append(number)
        if len(received) > 1:
            return kill()
        os.kill(child, number)
        signal.alarm(ORDERLY_END_S)

    signal.signal(signal.SIGALRM, lambda *_: kill())
    catch_signals(forward)
    return received


def _wait(child: int) -> int:
    """Wait for the end of the child.

    Returns:
        Its exit code, or minus the signal that ended it.
    """
    while True:
        try:
            return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        except InterruptedError:
            continue


def _explain(status: int, received: list[int]) -> int:
    """Say in one line why a child has ended suddenly, and return the exit code."""
    if received:
        print_error("interrupted; nothing half-written was left")
        return 128 + received[0]
    if status == -signal.SIGTERM or status == -signal.SIGINT:  # before the child could look at signals
        return 128 - status
    if status == -signal.SIGKILL or has_memory_limit():
        how = f"signal {-status}" if status < 0 else f"code {status}"
        print_error(f"not enough memory: expected more than this machine, or a limit, gives; the work ended with {how}")
        return EXIT_BAD_INPUT
    how = signal.Signals(-status).name if status < 0 else f"code {status}"
    print_error(f"a library ended the work ({how}); this is a defect of asfm {__version__}: please report it")
    return EXIT_DEFECT


def _read_told(source: int) -> tuple[list[Path], int | None]:
    """Return the temporary folders that the child has made, and its exit code if it came to an end of its own."""
    with os.fdopen(source, "rb") as file:
        os.set_blocking(source, False)  # a grandchild, such as the viewer, may hold the other end
        messages = (file.read() or b"").split(b"\0")
    folders = [Path(os.fsdecode(text.removeprefix(FOLDER))) for text in messages if text.startswith(FOLDER)]
    codes = [int(text.removeprefix(CODE)) for text in messages if text.startswith(CODE)]
    return folders, codes[-1] if codes else None


def _die_with_parent(parent: int) -> None:
    """Let the kernel kill this process when its parent dies (Linux; elsewhere the work is finished)."""
    if sys.platform != "linux":
        return
    import ctypes

    pr_set_pdeathsig = 1
    ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(EXIT_BAD_INPUT)
