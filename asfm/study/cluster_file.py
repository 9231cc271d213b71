"""Cluster file: the Dask cluster that a study starts, as a class of dask-jobqueue, or this machine, and arguments."""

import inspect
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from asfm.errors import AsfmError, quote, shorten
from asfm.safe_yaml import read_yaml
from asfm.study.dask_client import silence_dask

LOCAL = "local"
LOCAL_ARGUMENTS = ("local_directory", "memory_limit", "n_workers")
OBJECTS = frozenset({"self", "scheduler", "loop", "job_cls", "scheduler_cls"})
OWN = frozenset({"n_workers", "name", "asynchronous", "silence_logs", "dashboard_address", "host"})
"""Arguments of dask-jobqueue that asfm sets itself, or that belong into scheduler_options."""
SILENT = "CRITICAL"
CLOSE_S, SUBMIT_S = 3, 60


class ClusterSettings(BaseModel):
    """Content of a cluster file."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    kind: str = Field(alias="class")
    """A class of dask-jobqueue, or "local"."""
    jobs: int = Field(default=1, ge=1)
    """Number of jobs that the queueing system is asked for."""
    arguments: dict[str, Any] = Field(default_factory=dict)
    """Keyword arguments of the class."""


def read_cluster(path: Path) -> ClusterSettings:
    """Read a cluster file.

    Raises:
        AsfmError: the file cannot be read, a key, the class or an argument is unknown, or a value is invalid.
    """
    content = read_yaml(path, "the cluster")
    if not isinstance(content, dict):
        raise AsfmError(f"{path}: expected the keys class, jobs and arguments, found {quote(content)}")
    try:
        settings = ClusterSettings.model_validate(content)
    except ValidationError as fault:
        first = fault.errors(include_url=False, include_context=False)[0]
        name = quote(".".join(str(part) for part in first["loc"]))
        if first["type"] == "extra_forbidden":
            raise AsfmError(f"{path}: unknown key {name}; known here: arguments, class, jobs") from None
        message = f"{shorten(first['msg'])}, found {quote(first['input'])}"
        raise AsfmError(f"{path}: key {name} of the cluster: {message}") from None
    known = _list_arguments(path, settings.kind)
    for name in settings.arguments:
        if name not in known:
            listed = ", ".join(sorted(known))
            raise AsfmError(f"{path}: unknown argument {quote(name)} of {settings.kind}; known here: {listed}")
    return settings


@contextmanager
def start_cluster(path: Path, settings: ClusterSettings) -> Iterator[Any]:
    """Start a cluster, and stop it at the end.

    Args:
        path: of the cluster file, for messages.
        settings: its content.

    Raises:
        AsfmError: the queueing system is not there, or an argument is invalid.
    """
    silence_dask()
    try:
        cluster = _start_local(settings) if settings.kind == LOCAL else _start_queue(path, settings)
    except (TypeError, ValueError, OSError, RuntimeError, ImportError) as error:
        why = shorten(str(error) or type(error).__name__, 300)
        raise AsfmError(f"{path}: cannot start {settings.kind}: {why}") from None
    try:
        yield cluster
    finally:
        with suppress(OSError, TimeoutError):
            cluster.close(timeout=CLOSE_S)


def _start_local(settings: ClusterSettings) -> Any:
    from distributed import LocalCluster

    own = {"threads_per_worker": 1, "dashboard_address": None, "silence_logs": SILENT, "memory_limit": 0}
    return LocalCluster(**{**own, **settings.arguments})


def _start_queue(path: Path, settings: ClusterSettings) -> Any:
    """Start a scheduler here, and ask the queueing system for jobs of one thread a process."""
    kind, arguments = _find_classes()[settings.kind], dict(settings.arguments)
    command = str(kind.job_cls.submit_command).split()[0]
    if shutil.which(command) is None:
        raise AsfmError(f"{path}: {settings.kind} submits jobs by {command}, which this machine does not have")
    if "cores" in arguments:
        arguments.setdefault("processes", arguments["cores"])
    options = {"dashboard": False, "dashboard_address": ":0", **arguments.pop("scheduler_options", {})}
    cluster = kind(**arguments, scheduler_options=options, silence_logs=SILENT)
    cluster.scale(jobs=settings.jobs)
    try:
        _check_jobs(cluster, settings.jobs)
    except BaseException:
        with suppress(Exception):  # it does not like jobs that were never begun
            cluster.close(timeout=CLOSE_S)
        raise
    return cluster


def _check_jobs(cluster: Any, jobs: int) -> None:
    """Wait until all jobs are handed over to the queueing system, which must not refuse one.

    Raises:
        RuntimeError: it does; the message has its output.
    """
    deadline_s = time.monotonic() + SUBMIT_S
    while len(cluster.workers) < jobs and time.monotonic() < deadline_s:
        time.sleep(0.05)
    for job in cluster.workers.values():
        if job.job_id is None:
            cluster.sync(job.start)  # once more: what it raised was not kept


def _list_arguments(path: Path, name: str) -> frozenset[str]:
    """Return the names of the arguments of a class, those of its jobs included."""
    if name == LOCAL:
        return frozenset(LOCAL_ARGUMENTS)
    classes = _find_classes()
    if name not in classes:
        known = ", ".join([LOCAL, *sorted(classes)])
        raise AsfmError(f"{path}: expected as class one of {known}, found {quote(name)}")
    own = [owner for owner in classes[name].__mro__ if issubclass(owner, _get_base())]
    owners = [owner for owner in (*own, *classes[name].job_cls.__mro__) if "__init__" in vars(owner)]
    return frozenset(parameter for owner in owners for parameter in _list_parameters(owner)) - OBJECTS - OWN


def _list_parameters(owner: type) -> list[str]:
    kinds = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    parameters = inspect.signature(vars(owner)["__init__"]).parameters.values()
    return [parameter.name for parameter in parameters if parameter.kind in kinds]


def _find_classes() -> dict[str, Any]:
    """Return the clusters of dask-jobqueue by name."""
    import dask_jobqueue

    base = _get_base()
    found = {name: value for name, value in vars(dask_jobqueue).items() if isinstance(value, type)}
    return {name: value for name, value in found.items() if issubclass(value, base) and value is not base}


def _get_base() -> Any:
    from dask_jobqueue import JobQueueCluster

    return JobQueueCluster
