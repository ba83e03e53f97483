"""Worker: a process that takes folds from the queue and computes them, each exactly once.

A fold is a durable workflow: what a step returned is kept, so that after a crash it goes on with
the first step that has no result. The worker's name is what its unfinished folds are found by.
"""

from __future__ import annotations

import logging
import os
import signal
import sys
import threading
from collections.abc import Callable
from types import FrameType
from typing import Final

from dbos import DBOS, DBOSConfig

from server.jobs import APPLICATION, APPLICATION_VERSION, MOVIE_WORKFLOW, WORKFLOW, prepare
from server.logs import set_up_logs
from server.movie_jobs import MovieJobs
from server.runner import STAGES, Outcome, Runner
from server.settings import Settings
from server.slots import Slot
from server.store import Store

LOOK_EVERY_S: Final = 2.0
# A job ends so when not even its end could be noted, or when it took its worker along every time.
FAILED_JOBS: Final = ("ERROR", "MAX_RECOVERY_ATTEMPTS_EXCEEDED")
log = logging.getLogger("foldback.worker")


def register(runner: Runner, movies: MovieJobs) -> None:
    """Tells the job system what a fold is: one step a stage, then its end; and what a movie is."""

    def fold(fold_id: str) -> str:
        stage: str = STAGES[0]
        try:
            outcome: Outcome = DBOS.run_step({"name": stage}, runner.run, fold_id, stage)
            while (following := outcome["following"]) is not None and not outcome["ended"]:
                stage = following
                outcome = DBOS.run_step({"name": stage}, runner.run, fold_id, stage)
        except Exception as error:
            log.exception("fold %s failed", fold_id, extra={"fold": fold_id})
            outcome = runner.failure(error, stage)
        DBOS.run_step({"name": "finish"}, runner.finish, fold_id, outcome)
        return outcome["status"]

    def movie(fold_id: str, movie_id: str, job: str) -> None:
        DBOS.run_step({"name": "film"}, movies.make, fold_id, movie_id, job)

    DBOS.workflow(name=WORKFLOW)(fold)
    DBOS.workflow(name=MOVIE_WORKFLOW)(movie)


def _hold_leash(on_end: Callable[[], None]) -> None:
    """Calls back when standard input ends: whoever started this worker is gone."""

    def wait() -> None:
        while os.read(0, 1024):
            pass
        on_end()

    threading.Thread(target=wait, name="leash", daemon=True).start()


def _look_after(slot: Slot, store: Store, runner: Runner, stopping: threading.Event) -> None:
    """Takes over the folds of dead workers on this machine, and ends those whose job has failed."""
    while not stopping.wait(LOOK_EVERY_S):
        try:
            dead = set(slot.dead())
            if dead:
                running = DBOS.list_workflows(status="PENDING", load_input=False)
                left = sorted({str(w.executor_id) for w in running} & dead)
                if left:
                    log.info("taking over the folds of %s", ", ".join(left))
                    DBOS._recover_pending_workflows(left)  # pyright: ignore[reportPrivateUsage]
            for row in store.unfinished():
                job = DBOS.get_workflow_status(row.id)
                if job is not None and job.status in FAILED_JOBS:
                    log.error(
                        "fold %s: its job ended as %s", row.id, job.status, extra={"fold": row.id}
                    )
                    runner.finish(row.id, runner.failure(RuntimeError(job.status), row.stage))
        except Exception:
            log.exception("looking after folds failed")


def work(settings: Settings, *, leashed: bool = False) -> None:
    """Works until told to end, by a signal or by the end of who started it.

    Args:
        settings: The settings.
        leashed: End when standard input ends.
    """
    set_up_logs(settings)
    store = Store(settings)
    runner = Runner(settings, store)
    runner.prewarm()
    stopping = threading.Event()
    told = threading.Event()

    def tell(number: int = 0, frame: FrameType | None = None) -> None:
        told.set()

    signal.signal(signal.SIGTERM, tell)
    signal.signal(signal.SIGINT, tell)
    if leashed:
        _hold_leash(tell)
    slot = Slot(settings)
    set_up_logs(settings, worker=slot.name)
    prepare(settings)
    config: DBOSConfig = {
        "name": APPLICATION,
        "system_database_url": settings.queue_url,
        "application_version": APPLICATION_VERSION,
        "executor_id": slot.name,
        "log_level": "WARNING",
    }
    DBOS(config=config)
    register(runner, MovieJobs(settings, store))
    DBOS.launch()
    threading.Thread(target=_look_after, args=(slot, store, runner, stopping), daemon=True).start()
    log.info("worker %s is ready", slot.name)
    told.wait()
    log.info("worker %s ends; its folds go on when one starts again", slot.name)
    stopping.set()
    runner.stop()
    # Steps that were cut off must not get the time to note a result.
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)


if __name__ == "__main__":
    work(Settings(), leashed="--leashed" in sys.argv[1:])
