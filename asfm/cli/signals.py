"""Signals that stop a process in order: SIGINT, SIGTERM and SIGHUP."""

import signal
from collections.abc import Callable
from types import FrameType

SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))


class Stopped(KeyboardInterrupt):
    """A signal has asked the process to end; caught wherever KeyboardInterrupt is."""

    def __init__(self, number: int) -> None:
        """Name the signal by its number."""
        super().__init__(f"signal {number}")
        self.exit_code = 128 + number
        """As a shell reports it: 130 for SIGINT, 143 for SIGTERM, 129 for SIGHUP."""


def catch_signals(handle: Callable[[int], None]) -> None:
    """Call a function at each of the signals; what was ignored from the start (nohup, sh's ``&``) stays ignored.

    Args:
        handle: called in the main thread with the number of the signal.
    """

    def call(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 - the signature of a handler
        handle(number)

    for number in SIGNALS:
        if signal.getsignal(number) not in (signal.SIG_IGN, None):
            signal.signal(number, call)


def ignore_signals() -> None:
    """Ignore the signals from now on."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def raise_at_first_signal() -> None:
    """Raise Stopped in the main thread at the first signal; further ones must not disturb the cleaning up."""
    received: list[int] = []

    def stop(number: int) -> None:
        received.append(number)
        if len(received) == 1:
            raise Stopped(number)

    catch_signals(stop)
