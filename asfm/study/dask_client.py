"""Dask client: the connection to the scheduler of a cluster, whose faults are one line."""

import logging
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any

from asfm.errors import AsfmError, quote, shorten

CONNECT_S = 10.0
"""Longest time until a scheduler answers."""
NO_WORKER_S = 120.0
"""Longest time that a scheduler which somebody else has started may have no worker."""
CONNECTION_ERRORS = (OSError, TimeoutError)
ADDRESS = re.compile(r"([a-z]+://)?[^\s/:]+:\d{1,5}|([a-z]+://)?\[[0-9a-fA-F:.]+\]:\d{1,5}")


def require_distributed() -> None:
    """Check that Dask's distributed and dask-jobqueue can be loaded, before hours of work.

    Raises:
        AsfmError: one of them is not installed.
    """
    for package in ("distributed", "dask_jobqueue"):
        if find_spec(package) is None:
            raise AsfmError(
                f"--scheduler and --cluster need {package.replace('_', '-')}: install asfm with its extra, "
                "pip install 'asfm[cluster]'"
            )


def check_address(address: str) -> None:
    """Check the form of a scheduler's address.

    Raises:
        AsfmError: it is not protocol://host:port or host:port.
    """
    if not ADDRESS.fullmatch(address):
        raise AsfmError(f"--scheduler: expected an address such as tcp://host:8786, found {quote(address)}")


@contextmanager
def open_client(address: Any) -> Iterator[Any]:
    """Connect to a scheduler.

    Args:
        address: of the scheduler, or a cluster of Dask.

    Raises:
        AsfmError: it cannot be reached.
    """
    from distributed import Client

    silence_dask()
    name = address if isinstance(address, str) else address.scheduler_address
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # versions that differ: what matters is checked on the workers
            client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except Exception as error:  # whatever protocols and addresses come up with
        why = shorten(str(error) or type(error).__name__, 200)
        raise AsfmError(f"{name}: cannot reach a Dask scheduler there: {why}") from None
    try:
        with client.as_current():
            yield client
    finally:
        client.close(timeout=2)


def describe_loss(error: Exception | None) -> str:
    """Return what to say where a scheduler is there no more."""
    why = f" ({shorten(str(error))})" if error is not None and str(error) else ""
    return f"the connection to the Dask scheduler was lost{why}; finished cells are kept: run the study again to go on"


def silence_dask() -> None:
    """Keep Dask's own messages about workers that die off the terminal; a cell's row and one line say it."""
    for name in ("distributed", "tornado", "asyncio", "dask_jobqueue"):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
