"""Executors of sweeps: this machine, a Dask cluster at an address, or jobs of SLURM."""

from __future__ import annotations

import logging
import socket
import time
from collections.abc import Callable, Generator, Mapping
from concurrent.futures import CancelledError, Executor, Future, InvalidStateError
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from ipaddress import ip_address
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar, cast
from urllib.parse import urlsplit

from foldback.planner.cpu_cores import cores
from foldback.planner.errors import InputError
from foldback.planner.storage.files import json_of
from foldback.planner.sweeps.run import CASES_PER_WORKER

if TYPE_CHECKING:
    from distributed import Client, SpecCluster
    from distributed import Future as DaskFuture

T = TypeVar("T")
CONFIGURATION: Final = {
    # Machines that may end under a case before it counts as lost. A case cannot end its worker.
    "distributed.scheduler.allowed-failures": 10,
    # Cost processor time for as long as cases run.
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1 s",
    "distributed.admin.system-monitor.interval": "5 s",
    "distributed.scheduler.active-memory-manager.start": False,
    # Messages that Dask keeps for developers, 1000 of each connection. They contain the shapes.
    "distributed.admin.low-level-log-length": 10,
}
"""Configuration of Dask where foldback starts it."""
CONNECT_TIMEOUT: Final = "30 s"
"""Time that the first connection to a scheduler may take."""
RECONNECT_TIMEOUT: Final = "365 days"
"""Time for which a client waits until a scheduler that has ended is there again."""
SIZE_PERIOD_S: Final = 2.0
"""Time, in s, between two questions of how many workers a cluster has."""
MIN_CASES_AT_ONCE: Final = 64
"""Number of cases that a cluster is given if it has few workers, since more may come."""
JOB_MEMORY: Final = "4 GiB"
"""Memory of a SLURM job, as Dask writes it."""
SLURM: Final = "slurm"
"""Name of the place where a sweep starts its own jobs."""
log = logging.getLogger("foldback.sweeps")


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """Place where a sweep computes.

    Attributes:
        on: Address of a Dask scheduler (``tcp://…``, ``tls://…``), its scheduler file (``….json``),
            or ``slurm``; empty for this machine.
        workers: Number of cases that are computed at once: on this machine, all its processors by
            default; on SLURM, the number of jobs.
        walltime: Time limit of a SLURM job, as ``sbatch --time`` takes it.
        slurm: Options of ``sbatch``, without their dashes.
    """

    on: str = ""
    workers: int | None = None
    walltime: str = "04:00:00"
    slurm: Mapping[str, str] = field(default_factory=dict[str, str])


class DaskExecutor(Executor):
    """Executor on a Dask client, whose cases end when their command does."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self._size = 0
        self._size_read_s = float("-inf")

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Submit ``run_limited`` with a case.

        Dask's own executor leaves a future unfinished forever if the scheduler ends while a result
        is fetched; here it is cancelled.
        """
        future: Future[T] = Future()
        task = self._client.submit(fn, *args, pure=False, is_unwanted=is_unwanted, **kwargs)
        future.add_done_callback(partial(_cancel, task))
        task.add_done_callback(partial(_finish, future))
        return future

    def at_once(self) -> int:
        """Return the number of cases that the cluster is given at a time."""
        now_s = time.monotonic()
        if now_s - self._size_read_s > SIZE_PERIOD_S and self._client.status == "running":
            self._size_read_s = now_s
            self._size = int(
                self._client.scheduler_info(n_workers=0).get("total_threads", self._size)
            )
        return max(MIN_CASES_AT_ONCE, CASES_PER_WORKER * self._size)


def _cancel(task: DaskFuture[Any], future: Future[Any]) -> None:
    """Cancel a Dask task if its future is cancelled."""
    if future.cancelled():
        task.cancel()


def _finish(future: Future[Any], task: DaskFuture[Any]) -> None:
    """Pass the end of a Dask task on to a future."""
    with suppress(InvalidStateError):  # nobody waits for it any more
        try:
            error = cast("Exception | None", task.exception())
            if error is not None:
                future.set_exception(error)
            else:
                future.set_result(task.result())
        except (CancelledError, OSError):  # the scheduler has ended, before or while it answered
            future.cancel()
        except Exception as error:  # the answer cannot be read here
            future.set_exception(error)
    # Both futures refer to each other, and the collector of garbage frees them late.
    task.release()


def is_unwanted() -> bool:
    """Return True if no client waits for the Dask task of this thread any more."""
    from distributed import get_worker

    worker = get_worker()
    task = worker.state.tasks.get(worker.get_current_task())
    return task is None or task.state == "cancelled"


@contextmanager
def executor_on(place: Place) -> Generator[DaskExecutor]:
    """Yield an executor for cases; end what it has started.

    If the scheduler at an address ends, the executor waits until it is there again, and cases that
    it had are cancelled.

    Raises:
        InputError: ``no-scheduler`` if none answers; ``missing-package``.
    """
    import dask.config
    from distributed import Client

    with dask.config.set(CONFIGURATION):
        if place.on not in ("", SLURM):
            _check_scheduler(place.on)
            with Client(**_target(place.on), timeout=RECONNECT_TIMEOUT) as client:
                yield DaskExecutor(client)
            return
        with _cluster(place) as cluster, Client(cluster) as client:
            yield DaskExecutor(client)


def _target(on: str) -> dict[str, Any]:
    """Return the arguments of a client that state its scheduler."""
    return {"address": on} if "://" in on else {"scheduler_file": on}


def _check_scheduler(on: str) -> None:
    from distributed import Client
    from distributed.comm.addressing import get_address_host_port

    address = on if "://" in on else str(json_of(Path(on)).get("address"))
    if is_public(address):
        log.warning("%s is public and has no TLS: others may run programs there. Use tls://.", on)
    try:
        get_address_host_port(address, strict=True)
        Client(**_target(on), timeout=CONNECT_TIMEOUT).close()
    except (OSError, TypeError, ValueError) as error:  # TypeError: no certificates for tls://
        raise InputError(
            "no-scheduler",
            f"got {on!r}, where no Dask scheduler answered within {CONNECT_TIMEOUT} ({error}), "
            "expected an address such as tcp://head:8786, the scheduler file of 'dask scheduler "
            "--scheduler-file', or slurm; start workers with 'dask worker'.",
        ) from error


def is_public(address: str) -> bool:
    """Return True for a public address without TLS, through which strangers may run programs."""
    if address.startswith(("tls://", "wss://")):
        return False
    with suppress(OSError, ValueError):  # the connection fails, and says why
        infos = socket.getaddrinfo(urlsplit(address).hostname, None)
        return any(ip_address(info[4][0]).is_global for info in infos)
    return False


def _cluster(place: Place) -> SpecCluster:
    if place.on == SLURM:
        return _slurm_cluster(place)
    from distributed import LocalCluster, Security

    return LocalCluster(
        n_workers=place.workers or cores(),
        threads_per_worker=1,
        memory_limit=0,  # cases have limits of their own
        security=Security.temporary(),  # else all users of this machine may run programs here
        dashboard_address="127.0.0.1:0",  # its own port, for several sweeps at once
        silence_logs=logging.CRITICAL,  # workers that end with the scheduler report errors
    )


def _slurm_cluster(place: Place) -> SpecCluster:
    try:
        from dask_jobqueue.slurm import SLURMCluster
    except ImportError as error:
        raise InputError(
            "missing-package",
            "got no package dask-jobqueue, expected it; install it with pip install dask-jobqueue.",
        ) from error
    cluster = SLURMCluster(
        cores=1,
        processes=1,
        memory=JOB_MEMORY,
        walltime=place.walltime,
        scheduler_options={"dashboard_address": ":0"},
        job_extra_directives=[f"--{name}={value}" for name, value in place.slurm.items()],
    )
    cluster.adapt(maximum_jobs=place.workers or 1)
    return cluster
