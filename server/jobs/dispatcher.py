"""Dispatcher: takes jobs from the queue as slots become free, and computes each in a thread."""

from __future__ import annotations

import logging
import threading
import time
from typing import Final

from sqlalchemy.exc import SQLAlchemyError

from foldback.server.jobs.execution import NotFinishedError
from foldback.server.jobs.movie_runner import MovieJobs
from foldback.server.jobs.queue import Claim, FoldClaim, Lane, Queue
from foldback.server.jobs.retry import retry_until_available
from foldback.server.jobs.runner import Runner
from foldback.server.ops.logs import about
from foldback.server.ops.tracing import span
from foldback.server.store.leases import Lease
from foldback.server.store.schema import passes

RETRY_S: Final = 0.1
"""Time after an unexpected error of a job before it goes back into the queue, in s."""
log = logging.getLogger("foldback.worker")


class Dispatcher:
    """Threads that compute the jobs that this worker has claimed.

    Args:
        queue: The queue.
        runner: Computes folds.
        movies: Makes movies.
        worker: Name of this worker.
        folds_at_once: Maximum number of long folds, and of quick ones, at the same time.
    """

    def __init__(
        self,
        queue: Queue,
        runner: Runner,
        movies: MovieJobs,
        *,
        worker: str,
        folds_at_once: int,
    ) -> None:
        self._queue = queue
        self._runner = runner
        self._movies = movies
        self._worker = worker
        # One movie: software OpenGL and the encoder occupy all cores of a small machine.
        self._free = {Lane.LONG: folds_at_once, Lane.QUICK: folds_at_once, Lane.MOVIES: 1}
        self._total = sum(self._free.values())
        self._changed = threading.Condition()
        self._woken = False
        self._closed = False

    def start(self, lease: Lease) -> None:
        """Start taking jobs, while the lease of this worker is held."""
        threading.Thread(
            target=self._take_jobs, args=(lease,), name="dispatcher", daemon=True
        ).start()

    def wake(self) -> None:
        """Look for jobs now."""
        with self._changed:
            self._woken = True
            self._changed.notify_all()

    def close(self) -> None:
        """Take no more jobs; running ones continue."""
        with self._changed:
            self._closed = True
        self.wake()

    def wait_idle(self, timeout_s: float) -> bool:
        """Wait until no job is running; return False on a timeout."""
        with self._changed:
            return self._changed.wait_for(lambda: self.active == 0, timeout_s)

    @property
    def active(self) -> int:
        """Number of jobs that are being computed."""
        return self._total - sum(self._free.values())

    def _take_jobs(self, lease: Lease) -> None:
        is_logged = False
        while not self._closed:
            self._woken = took = False
            try:
                if lease.held and self._queue.has_work():
                    for lane in Lane:
                        took |= self._take(lane)
                is_logged = False
            except Exception as error:
                if not (isinstance(error, SQLAlchemyError) and passes(error)):
                    log.exception("the queue cannot be read")
                elif not is_logged:
                    log.warning("the queue does not answer: %s", error)
                is_logged = True
            if not took:
                with self._changed:
                    self._changed.wait_for(lambda: self._woken, lease.queue_poll_s)

    def _take(self, lane: Lane) -> bool:
        """Start the next job of a lane; return False if there is no free slot or no job."""
        if self._closed or not self._free[lane]:
            return False
        claim = self._queue.claim(lane, self._worker)
        if claim is None:
            return False
        with self._changed:
            self._free[lane] -= 1
        threading.Thread(
            target=self._compute, args=(claim, lane), name=claim.fold_id, daemon=True
        ).start()
        return True

    def _compute(self, claim: Claim, lane: Lane) -> None:
        try:
            if isinstance(claim, FoldClaim):
                with about(fold=claim.fold_id), span("fold", fold_id=claim.fold_id):
                    self._runner.execution(claim).run()
            else:
                with about(fold=claim.fold_id, movie=claim.movie_id), span("movie"):
                    self._movies.make(claim)
        except Exception as error:
            if not isinstance(error, NotFinishedError):
                log.exception("job %s goes back to the queue", claim.execution)
                time.sleep(RETRY_S)
            # No effect if another execution has the job or it is already in the queue.
            retry_until_available(lambda: self._queue.hand_back(claim))
        finally:
            with self._changed:
                self._free[lane] += 1
            self.wake()
