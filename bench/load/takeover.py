"""Takeover: time until another worker has the fold of a dead one, and the cost of idle workers."""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable, Generator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Final

import psutil
import sqlalchemy as sa

from bench.sections import Section
from foldback.server.settings import Settings
from foldback.server.store.schema import FoldRow, WorkerRow, engine_for
from tests.server.bucket import Bucket
from tests.server.postgres import Postgres
from tests.server.service_process import STAIRS, Service, owner, wait_until

LEASE_S: Final = 15.0
"""Lease of the workers, in s: the default of the service."""
MAX_KILL_TAKEOVER_S: Final = 1.0
"""Maximum time from the end of a worker until one on another machine has its fold, in s."""
TAKEOVERS: Final = 5
"""Number of workers that are killed, and of those that are suspended."""
WAITS: Final = 20
"""Number of folds whose wait for a free worker is measured."""
SETTLE_S: Final = 10.0
"""Time from the start of an idle worker to the measurement, in s, in which it loads libraries."""
IDLE_S: Final = 60.0
"""Time for which the processor time of an idle worker is measured, in s."""
DATABASES: Final = ("SQLite", "PostgreSQL")


def takeover(short: bool = False) -> Section:
    """Measure takeovers between two machines, waits for a free worker, and idle workers."""
    section = Section(name="takeover")
    with closing(Postgres().start()) as postgres, closing(Bucket().start()) as bucket:
        with _machines(postgres, bucket) as machines:
            for name, end in (("killed", _kill), ("suspended", _suspend)):
                times_s = [machines.takeover_s(end) for _ in range(1 if short else TAKEOVERS)]
                most_s = MAX_KILL_TAKEOVER_S if end is _kill else 2.0 * LEASE_S
                section.rows += [{"worker": name, "takeover, s": took_s} for took_s in times_s]
                section.add(
                    f"takeover from a worker that was {name}",
                    f"{statistics.median(times_s):.2f} s, at most {max(times_s):.2f} s",
                    f"≤ {most_s:g} s",
                    None if short else max(times_s) <= most_s,
                )
        for name in DATABASES:
            _measure_idle(section, name, postgres, short=short)
    return section


class _Machines:
    """Web process and two machines with a worker each, which share only database and storage."""

    def __init__(self, place: Path, shared: dict[str, object], environment: dict[str, str]) -> None:
        self._engine = engine_for(Settings(database_url=str(shared["database_url"])).store_url)
        self.web = Service(place / "web", environment=environment, **shared).start()
        self._hosts = [
            Service(place / f"host-{k}", environment=environment, **shared) for k in range(2)
        ]
        self._workers = [host.start_worker() for host in self._hosts]

    def takeover_s(self, end: Callable[[psutil.Process], None]) -> float:
        """Return the seconds from the end of the worker of a fold until another one has it."""
        self._start_missing()
        fold = self.web.fold(shape="wrench-160", preset="paper")
        wait_until(lambda: self._fold(fold["id"]).stage == "explode", self.web.log.read_text)
        holder, pid = self._holder(fold["id"])
        worker = psutil.Process(pid)
        processes = [worker, *worker.children(recursive=True)]
        start_s = time.monotonic()
        end(worker)
        while self._holder(fold["id"])[0] in (holder, ""):
            time.sleep(0.01)
        took_s = time.monotonic() - start_s
        for process in processes:
            with suppress(psutil.NoSuchProcess):
                process.resume()
        path = f"/api/folds/{fold['id']}/cancel"
        self.web.http.post(path, headers=owner(fold)).raise_for_status()
        self.web.wait_over(fold["id"])
        return took_s

    def close(self) -> None:
        """End all processes."""
        for worker in self._workers:
            worker.terminate()
            worker.wait()
        self.web.stop()
        self._engine.dispose()

    def _start_missing(self) -> None:
        for k, worker in enumerate(self._workers):
            if worker.poll() is not None:
                self._workers[k] = self._hosts[k].start_worker()
        pids = {worker.pid for worker in self._workers}
        wait_until(lambda: pids <= set(self._scalars(sa.select(WorkerRow.pid))))

    def _fold(self, fold_id: str) -> sa.Row[tuple[str | None, str | None]]:
        with self._engine.connect() as connection:
            query = sa.select(FoldRow.stage, FoldRow.worker).where(FoldRow.id == fold_id)
            return connection.execute(query).one()

    def _holder(self, fold_id: str) -> tuple[str, int]:
        """Return the name of the worker that has a fold, and the id of its process."""
        name = (self._fold(fold_id).worker or "").rpartition(":")[0]
        pids = self._scalars(sa.select(WorkerRow.pid).where(WorkerRow.name == name))
        return name, next(iter(pids), 0)

    def _scalars(self, query: sa.Select[tuple[int]]) -> list[int]:
        with self._engine.connect() as connection:
            return list(connection.scalars(query))


@contextmanager
def _machines(postgres: Postgres, bucket: Bucket) -> Generator[_Machines]:
    shared = {"database_url": postgres.migrated(), "storage_url": bucket.bucket()}
    with tempfile.TemporaryDirectory(prefix="foldback-takeover-") as place:
        settings = {**shared, "workers": 0, "lease_s": LEASE_S}
        with closing(_Machines(Path(place), settings, bucket.environment)) as machines:
            yield machines


def _kill(worker: psutil.Process) -> None:
    worker.kill()


def _suspend(worker: psutil.Process) -> None:
    """Suspend a worker with its children, as on a frozen machine."""
    for process in [worker, *worker.children(recursive=True)]:
        process.suspend()


def _measure_idle(section: Section, name: str, postgres: Postgres, *, short: bool) -> None:
    """Measure the waits of folds for a free worker, then the processor time without folds."""
    settings: dict[str, object] = {"workers": 0}
    if name == "PostgreSQL":
        settings["database_url"] = postgres.migrated()
    with (
        tempfile.TemporaryDirectory(prefix="foldback-idle-") as place,
        Service(Path(place) / "data", environment={}, wrapper=(), **settings).start() as web,
        web.worker() as worker,
    ):
        wait_until(lambda: "is ready" in web.log.read_text(), web.log.read_text)
        waits_s = [_wait_s(web) for _ in range(2 if short else WAITS)]
        time.sleep(1.0 if short else SETTLE_S)
        passed_s = 2.0 if short else IDLE_S
        processes = {"worker": worker.pid}
        if name == "PostgreSQL":
            processes[name] = postgres.pid
        before = {about: _busy_s(pid) for about, pid in processes.items()}
        time.sleep(passed_s)
        for about, pid in processes.items():
            busy = (_busy_s(pid) - before[about]) / passed_s
            section.add(f"idle worker on {name}: {about}", f"{busy:.2%} of a core")
    mean_s, median_s = statistics.mean(waits_s), statistics.median(waits_s)
    words = f"mean {1e3 * mean_s:.0f} ms, median {1e3 * median_s:.0f} ms"
    section.add(f"wait of a fold for a free worker on {name}", words)


def _wait_s(web: Service) -> float:
    """Return the seconds that a fold waits for a worker that has nothing to do."""
    fold_id = web.fold(STAIRS)["id"]
    web.wait_over(fold_id)
    settings = Settings(
        data_dir=web.data_dir, database_url=web.environment.get("FOLDBACK_DATABASE_URL")
    )
    engine = engine_for(settings.store_url)
    took = FoldRow.started_at - FoldRow.created_at
    try:
        with engine.connect() as connection:
            return connection.scalars(sa.select(took).where(FoldRow.id == fold_id)).one() or 0.0
    finally:
        engine.dispose()


def _busy_s(pid: int) -> float:
    """Return the processor time of a process and its children so far, s."""
    process = psutil.Process(pid)
    return sum(sum(each.cpu_times()[:4]) for each in [process, *process.children(recursive=True)])
