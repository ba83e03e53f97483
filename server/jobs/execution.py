"""Execution: a worker's computation of a fold, from its checkpoint to its end."""

from __future__ import annotations

import contextlib
import json
import logging
import threading
import time
from collections.abc import Callable, Generator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from sqlalchemy.exc import SQLAlchemyError

from foldback.planner.chain.built_in_modules import module_of
from foldback.planner.errors import InputError, TimelineError
from foldback.planner.motion.timeline import Timeline, TimelineWriter
from foldback.planner.pipeline.fold_layout import any_verified, result_path
from foldback.planner.progress import STAGE_TEXTS, STAGES
from foldback.planner.readers.gallery import Gallery
from foldback.planner.storage.file_names import START_CHAIN, TIMELINE
from foldback.server.errors import UNEXPECTED_WORDS
from foldback.server.jobs.housekeeping import limit_cancelled
from foldback.server.jobs.processor_wait import ProcessorWait
from foldback.server.jobs.progress import REPEATED_STAGES, JobProgress
from foldback.server.jobs.queue import MAX_LOSSES, FoldClaim, Queue
from foldback.server.jobs.retry import RETRY_INTERVAL_S, Answer, retry_until_available
from foldback.server.jobs.slices import Slice
from foldback.server.ops.tracing import span
from foldback.server.processes.children import CRASHED, LOST, Child, ChildError, Children
from foldback.server.store.fold_files import frames_promised
from foldback.server.store.folds import NoSuchFoldError, Store
from foldback.server.store.object_store import StorageError

MAX_CRASHES: Final = 3
"""Number of crashes of the computing process within one stage of a fold (such as the explosion or
the certificate) after which the fold fails. With 1 a single accident fails a fold."""
log = logging.getLogger("foldback.worker")


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """Result of a stage.

    Attributes:
        status: Status of the fold.
        following: The next stage; None if the fold has ended.
        summary: Figures of the result.
        error: ``code``, ``detail`` and ``where`` of the error, or None.
        repeatable: True if the same upload would have the same result.
        files: Epoch of the fold's files.
        size: Total size of these files, bytes; None if unknown.
    """

    status: str
    following: str | None = None
    summary: dict[str, Any] = field(default_factory=dict[str, Any])
    error: dict[str, Any] | None = None
    repeatable: bool = True
    files: int = 0
    size: int | None = None


class NotFinishedError(Exception):
    """The execution ends before its fold and must store nothing more."""


class LeaseLostError(NotFinishedError):
    """Another execution has the fold."""


class StoppingError(NotFinishedError):
    """The worker stops; another one continues the fold."""


class PausedError(NotFinishedError):
    """The fold is back in the queue, because its slice is over and others wait."""


class CancelledError(Exception):
    """The fold was cancelled during a wait."""


def internal_failure(stage: str | None) -> Outcome:
    """Return the outcome of an internal error of the service."""
    return Outcome(
        status="failed",
        error={"code": "internal", "detail": UNEXPECTED_WORDS, "where": stage},
        repeatable=False,
    )


class Execution:
    """Computation of one fold in a child process with limits.

    Args:
        claim: The fold, and the stage at which it continues.
        store: Rows and files.
        children: Processes that compute stages.
        stage_seconds: Maximum duration of a stage, in s.
        stopping: Event that is set once the worker stops.
    """

    def __init__(
        self,
        claim: FoldClaim,
        *,
        store: Store,
        children: Children,
        stage_seconds: float,
        stopping: threading.Event,
    ) -> None:
        self._claim = claim
        self._fold_id = claim.fold_id
        self._store = store
        self._queue = Queue(store)
        self._children = children
        self._stage_seconds = stage_seconds
        self._stopping = stopping
        self._child: Child | None = None
        self._slice: Slice | None = None
        self._processor_wait = ProcessorWait()
        self._epoch = 0

    @property
    def _place(self) -> Path:
        """Directory in which the fold is computed."""
        return self._store.folders.work_place(self._fold_id, self._epoch)

    def run(self) -> None:
        """Compute the fold to its end, and store the result.

        Raises:
            NotFinishedError: If it does not end here.
        """
        try:
            stage, files = self._claim.stage, self._claim.files
            while True:
                with span(stage):
                    outcome = self.compute(stage, files)
                if outcome.following is None:
                    break
                stage, files = outcome.following, outcome.files
                self._checkpoint(stage, files)
            self.finish(outcome)
        finally:
            self._release_child()

    def compute(self, stage: str, files: int) -> Outcome:
        """Compute one stage and store its files. Failures are returned as outcomes.

        Args:
            stage: The stage.
            files: Epoch of the files that it starts from.

        Raises:
            NotFinishedError: If it does not end here.
        """
        try:
            epoch = self._wait_for(
                lambda: self._store.begin(self._fold_id, stage, self._claim.execution)
            )
            if epoch is None:
                return self._concluded(self._unwanted(), stage, files)
            self._epoch = epoch
            outcome = self._attempt(stage, files)
            if outcome.following is None:
                outcome = self._concluded(outcome, stage, epoch)
            size = self._unless_cancelled(lambda: self._store.folders.keep(self._fold_id, epoch))
            return replace(outcome, files=epoch, size=size)
        except CancelledError:
            outcome = self._unwanted()  # first, because another execution may have the files
            self._close()
            return replace(outcome, files=files)  # the files of this stage are dropped

    def finish(self, outcome: Outcome) -> None:
        """Store the result of the fold in its row, or clean up after a deleted one.

        Raises:
            LeaseLostError: If another execution has the fold.
        """
        has_row = self._wait_for(
            lambda: self._store.finish(
                self._fold_id,
                outcome.status,
                summary=outcome.summary,
                error=outcome.error,
                repeatable=outcome.repeatable,
                kept_epoch=outcome.files,
                size=outcome.size,
                execution=self._claim.execution,
            )
        )
        if not has_row:
            self._wait_for(lambda: self._store.folders.remove(self._fold_id))
            return
        self._check_held()
        if outcome.status != "cancelled":
            self._wait_for(lambda: self._store.folders.leave(self._fold_id, outcome.files))
        else:
            # No retries: the visitor may be waiting for the worker to start another fold.
            with contextlib.suppress(StorageError, SQLAlchemyError, NoSuchFoldError):
                self._store.folders.leave(self._fold_id, outcome.files)
                limit_cancelled(self._store, self._store.fold(self._fold_id).visitor)
        self._wait_for(lambda: self._queue.release(self._claim))

    def _checkpoint(self, stage: str, files: int) -> None:
        if not self._wait_for(lambda: self._queue.keep(self._claim, stage=stage, files=files)):
            self._check_held()

    def _check_held(self) -> None:
        """Check that no other execution has the fold.

        Raises:
            LeaseLostError: If another execution has it.
        """
        with contextlib.suppress(NoSuchFoldError):
            row = self._wait_for(lambda: self._store.fold(self._fold_id))
            if row.worker != self._claim.execution:
                log.warning("fold %s was taken over by %s", self._fold_id, row.worker or "nobody")
                raise LeaseLostError(self._fold_id)

    def _attempt(self, stage: str, files: int) -> Outcome:
        """Compute a stage; return any failure as an outcome."""
        if self._claim.losses >= MAX_LOSSES:
            return internal_failure(stage)
        try:
            return self._run(stage, files)
        except (NotFinishedError, CancelledError):
            raise
        except InputError as error:
            error = self._advised(error)
            fault = {"code": error.code, "values": error.values, "detail": error.detail}
            fault |= {"message": error.message, "where": error.where}
            return Outcome(status="failed", error=fault)
        except ChildError as error:
            self._release_child()
            if stage in REPEATED_STAGES and any_verified(self._place):
                # The attempt at a better plan failed, so the best plan so far is the result.
                return Outcome(status="running", following=STAGES[-1])
            fault = {"code": error.code, "detail": error.detail, "where": stage}
            return Outcome(status="failed", error=fault, repeatable=False)
        except Exception:
            self._check_stopping()
            log.exception("fold %s failed in stage %s", self._fold_id, stage)
            return internal_failure(stage)

    def _concluded(self, outcome: Outcome, stage: str, files: int) -> Outcome:
        """Close the child and timeline of a fold that ends; add its last state if it failed."""
        outcome = replace(outcome, files=files)
        self._check_stopping()
        self._close()
        log.info("fold %s: %s in stage %s", self._fold_id, outcome.status, stage)
        if outcome.status == "verified" or outcome.summary:
            return outcome
        return replace(outcome, summary=self._last_state())

    def _run(self, stage: str, files: int) -> Outcome:
        directory = self._unless_cancelled(
            lambda: self._store.folders.bring(self._fold_id, files, self._epoch)
        )
        spent_s = self._wait_for(lambda: self._store.stage_s(self._fold_id))
        started_at = time.time()
        progress = JobProgress(self._report, _first_progress(stage, spent_s, started_at))
        part = self._slice
        if part is None:
            part = self._wait_for(lambda: Slice(self._store, self._fold_id, self._epoch))
            self._slice = part
        with _keeping(self._store, self._fold_id, self._epoch):
            result = self._call(
                stage,
                directory,
                on_progress=progress.take,
                cancelled=lambda: progress.cancelled() or part.over(),
            )
        ended_at = time.time()
        took_s = round(spent_s.get(stage, 0.0) + ended_at - started_at, 3)
        progress.take({"stage_s": {**spent_s, stage: took_s}, "began_at": ended_at})
        fold_wanted = self._wait_for(progress.last)
        # A cancelled stage may still return a result, computed from its data until then.
        if part.ended and fold_wanted and self._wait_for(part.pause):
            raise PausedError(self._fold_id)
        if part.ended or result.get("status") == "cancelled" or not fold_wanted:
            return self._unwanted()
        if stage == "read":
            self._wait_for(
                lambda: self._store.describe(
                    self._fold_id,
                    name=str(result["name"]),
                    modules=int(result["modules"]),
                    module=str(result["module"]),
                    module_words=result["module_words"],
                )
            )
        if stage == STAGES[-1]:
            status = "verified" if result.get("status") == "verified" else "failed"
            error = None
            if status == "failed":
                reason = str(
                    result.get("reason")
                    or "the plan could not be verified, and no reason was recorded."
                )
                error = {"code": "not-verified", "detail": reason, "where": None}
            return Outcome(status=status, summary=result, error=error)
        # After a plan that the certificate has refused, the fold retries with other settings.
        following = result.get("again") or STAGES[STAGES.index(stage) + 1]
        return Outcome(status="running", following=following)

    def _report(self, fields: dict[str, Any] | None = None) -> bool:
        """Store the progress of a stage; return False if the fold is no longer wanted."""
        if fields is not None:
            child = self._child
            busy = child is not None and self._processor_wait.busy(child.pid)
            fields = {**fields, "frames": frames_promised(self._place), "busy": busy}
        return self._store.report(self._fold_id, self._epoch, fields)

    def _call(
        self,
        stage: str,
        directory: Path,
        *,
        on_progress: Callable[[dict[str, Any]], None],
        cancelled: Callable[[], bool],
    ) -> dict[str, Any]:
        """Compute a stage in the child of this execution; replace a child that crashes.

        Raises:
            InputError: If the input is invalid.
            ChildError: If a limit was exceeded, or ``MAX_CRASHES`` children crashed.
            StoppingError: If the worker stops.
        """
        deaths = 0
        while True:
            child = self._child = self._child or self._children.take()
            try:
                answer = child.call(
                    stage,
                    directory,
                    wall_s=self._stage_seconds,
                    epoch=self._epoch,
                    on_progress=on_progress,
                    cancelled=cancelled,
                )
                self._check_stopping()
                return answer
            except ChildError as error:
                self._check_stopping()
                if error.code not in (CRASHED, LOST):
                    raise
                self._release_child()
                deaths += error.code == CRASHED
                if deaths == MAX_CRASHES:
                    detail = (
                        f"{error.detail} This happened {deaths} times during {STAGE_TEXTS[stage]}."
                    )
                    raise ChildError(CRASHED, detail) from None
                log.warning("stage=%s directory=%s restarts: %s", stage, directory, error)
            self._wait(RETRY_INTERVAL_S)
            if cancelled():
                return {"status": "cancelled", "reason": "cancelled"}

    def _advised(self, error: InputError) -> InputError:
        """Return the refusal, extended by shapes into which a refold is possible."""
        if error.code != "refold-differs":
            return error
        start = json.loads((self._place / START_CHAIN).read_bytes())
        return Gallery().advised(error, module_of(start["module"]).name, int(start["modules"]))

    def _unwanted(self) -> Outcome:
        """Return the outcome of a fold that was cancelled or deleted.

        Raises:
            LeaseLostError: If another execution has the fold.
        """
        self._check_held()
        return Outcome(status="cancelled", repeatable=False)

    def _wait_for(self, do: Callable[[], Answer]) -> Answer:
        """Call ``do`` until the database, the storage and the disk answer.

        Raises:
            StoppingError: If the worker stops meanwhile.
        """
        return retry_until_available(do, wait=self._wait)

    def _unless_cancelled(self, do: Callable[[], Answer]) -> Answer:
        """Call ``do`` until the storage answers or the fold is cancelled.

        Raises:
            CancelledError: If the fold was cancelled or taken over meanwhile.
            StoppingError: If the worker stops meanwhile.
        """

        def wait(seconds: float) -> None:
            self._wait(seconds)
            with contextlib.suppress(SQLAlchemyError):
                if not self._report():
                    raise CancelledError(self._fold_id)

        return retry_until_available(do, wait=wait)

    def _wait(self, seconds: float) -> None:
        self._stopping.wait(seconds)
        self._check_stopping()

    def _check_stopping(self) -> None:
        # The worker has ended the child, so its answer is not a result.
        if self._stopping.is_set():
            raise StoppingError(self._fold_id)

    def _close(self) -> None:
        """Release the child, and close the timeline if the stage was killed before closing it."""
        self._release_child()
        path = result_path(self._place, TIMELINE)
        with contextlib.suppress(TimelineError, OSError, ValueError, KeyError):
            if Timeline.open(path).status == "growing":
                TimelineWriter.reopen(path).close("failed")

    def _last_state(self) -> dict[str, Any]:
        """Return the last known state of a fold that did not finish: its frame and its attempts."""
        try:
            # This loads the simulation, which is needed only if the end of a fold was missed.
            from foldback.planner.pipeline.workspace import Workspace

            return Workspace(self._place).settle()
        except Exception:
            log.exception("fold %s cannot be read", self._fold_id)
            return {}

    def _release_child(self) -> None:
        if self._child is not None:
            self._children.release(self._child)
            self._child = None


@contextlib.contextmanager
def _keeping(store: Store, fold_id: str, epoch: int) -> Generator[None]:
    """Upload growing files while a stage computes, so that other machines can read them."""
    folders = store.folders
    if folders.storage is None:
        yield
        return
    over = threading.Event()

    def keep() -> None:
        is_displayed = False
        while True:
            try:
                folders.keep(fold_id, epoch, growing=True)
                if not is_displayed:
                    store.show(fold_id, epoch)
                    is_displayed = True
            except (StorageError, SQLAlchemyError, OSError) as error:
                log.warning(
                    "fold %s could not be stored yet: %s",
                    fold_id,
                    error,
                    extra={"fold": fold_id},
                )
            if over.wait(0.7):
                return

    thread = threading.Thread(target=keep, name="keeping", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def _first_progress(stage: str, spent_s: dict[str, float], started_at: float) -> dict[str, Any]:
    """Return the progress of a stage that starts, as a fold's row stores it."""
    return {
        "stage": stage,
        "fraction": 0.0,
        "steps": 0,
        "steps_per_second": 0.0,
        "simulated_s": 0.0,
        "message": "",
        "plan": 0,
        "plans": 0,
        "stage_s": spent_s,
        "began_at": started_at,
    }
