"""Runner: computes the stages of folds in child processes and updates their rows."""

from __future__ import annotations

import contextlib
import json
import logging
import threading
import time
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any, Final, TypedDict

from sqlalchemy.exc import SQLAlchemyError

from planner.errors import InputError, TimelineError
from planner.file_names import START_CHAIN, TIMELINE
from planner.motion.timeline import Timeline, TimelineWriter
from planner.pipeline.fold_layout import any_verified, result
from planner.progress import COMPILING
from planner.readers.gallery import Gallery
from server.files.cancelled import sweep_cancelled_of
from server.jobs.progress import REPEATED_STAGES, STAGES, JobProgress
from server.jobs.queue import place_of
from server.jobs.retry import RETRY_INTERVAL_S, Answer, retry_until_available
from server.jobs.slices import Slice
from server.processes.children import CRASHED, LOST, Child, ChildError, Children
from server.processes.fork_server import ForkServer
from server.processes.limits import ChildLimits
from server.settings import Settings
from server.store.fold_files import frames_promised
from server.store.folds import NoSuchFoldError, Store
from server.store.object_store import StorageError

UPLOAD_INTERVAL_S: Final = 0.7
"""Time between two copies of a running fold's motion to the object store, in s. A larger value
shows frames later; a smaller one transfers more. Chosen."""
MAX_CRASHES: Final = 3
"""Number of crashes of the computing process within one stage after which a fold fails. With 1 a
single accident fails a fold; with a larger value a fold that always crashes occupies a worker for
longer. Chosen."""
log = logging.getLogger("foldback.worker")


class Outcome(TypedDict):
    """Result of a stage.

    ``ended`` is True if the fold ends with it, ``following`` the next stage. ``epoch`` is the epoch
    of its files, ``bytes`` their size, None if unknown. ``paused_by`` is the execution that has put
    the fold back into the queue in the middle of the stage; None if the stage has ended.
    """

    epoch: int
    bytes: int | None
    ended: bool
    following: str | None
    status: str
    summary: dict[str, Any]
    error: dict[str, Any] | None
    repeatable: bool
    paused_by: str | None


def _outcome(
    status: str,
    *,
    ended: bool = True,
    following: str | None = None,
    summary: dict[str, Any] | None = None,
    error: dict[str, Any] | None = None,
    repeatable: bool = True,
    paused_by: str | None = None,
) -> Outcome:
    return {
        "epoch": 0,
        "bytes": None,
        "ended": ended,
        "following": following,
        "status": status,
        "summary": summary or {},
        "error": error,
        "repeatable": repeatable,
        "paused_by": paused_by,
    }


class LeaseLostError(Exception):
    """The fold has gone to another execution; the result here is discarded."""


class JobCancelledError(Exception):
    """The fold was cancelled or taken over while something was waited for."""


class PausedError(Exception):
    """The fold has been put back into the queue, as others wait and its slice is over."""


class Runner:
    """Children of the folds that are being computed, one for each.

    Args:
        settings: The settings.
        store: Rows and files.
        fork_server: One that forks for others, too: it goes on when this ends.
    """

    def __init__(
        self, settings: Settings, store: Store, *, fork_server: ForkServer | None = None
    ) -> None:
        self._settings = settings
        self._store = store
        self._shared = fork_server is not None
        self._fork_server = fork_server or ForkServer.where_possible(
            ["stages"], warm=settings.prewarm, directory=settings.root
        )
        self._children = Children("stages", ChildLimits.of(settings), self._fork_server)
        self._taken: dict[str, Child] = {}
        self._slices: dict[str, Slice] = {}
        self._stopping = threading.Event()

    def prewarm(self) -> None:
        """Load what the first fold would wait for, unless the settings forbid it."""
        if self._settings.prewarm and self._fork_server is not None:
            self._fork_server.start()

    def preparing(self) -> float | None:
        """Return the compiled fraction of the kernels, 0 to 1; None unless they are compiling.

        It is 0 while the fork server starts: only then it is known whether anything is to compile.
        """
        if self._fork_server is None:
            return None
        told = self._fork_server.told
        if told is None:
            return 0.0 if self._fork_server.starting else None
        return float(told["fraction"]) if told["message"] == COMPILING else None

    def stop(self) -> None:
        """Stop all children; their folds continue elsewhere or after the next start."""
        self._stopping.set()
        self._children.close()
        if self._fork_server is not None and not self._shared:
            self._fork_server.close()

    def run(self, fold_id: str, stage: str, worker: str, known: int) -> Outcome:
        """Compute one stage of a fold. Any failure of it is an outcome.

        Args:
            fold_id: The fold.
            stage: The stage.
            worker: Name of the execution, unique for each.
            known: The epoch under which the stage before was computed.

        Raises:
            LeaseLostError: When it has gone to another execution meanwhile.
        """
        epoch = known
        try:
            begun = self.retry_until_available(lambda: self._store.begin(fold_id, stage, worker))
            if begun is None:
                outcome = self._stopped(fold_id, None)
            else:
                epoch = begun
                outcome = self._run(fold_id, stage, worker, known, epoch)
        except LeaseLostError:
            self._release(worker)
            raise
        except JobCancelledError:
            # What it has made so far is kept nowhere.
            self._release(worker)
            return {**self._stopped(fold_id, epoch), "epoch": known}
        except PausedError:
            self._release(worker)
            paused = _outcome("queued", ended=False, following=stage, paused_by=worker)
            return {**paused, "epoch": known}
        except InputError as error:
            error = self._advised(fold_id, error)
            outcome = _outcome(
                "failed",
                error={"code": error.code, "detail": error.detail, "where": error.where},
            )
        except ChildError as error:
            self._release(worker)
            place = self._store.folders.place(fold_id)
            if stage in REPEATED_STAGES and any_verified(place):
                # What was tried for a better plan went wrong: the best one so far is the fold's.
                outcome = _outcome("running", ended=False, following=STAGES[-1])
            else:
                outcome = _outcome(
                    "failed",
                    error={"code": error.code, "detail": error.detail, "where": stage},
                    repeatable=False,
                )
        except Exception as error:
            log.exception("fold %s failed in stage %s", fold_id, stage, extra={"fold": fold_id})
            outcome = self.failure(error, stage)
        self._block_until_exit()
        outcome["epoch"] = epoch
        if outcome["ended"]:
            self._release(worker)
            self._close(fold_id)
            if outcome["status"] != "verified" and not outcome["summary"]:
                outcome["summary"] = self._looked_back(fold_id)
            log.info(
                "fold %s: %s in stage %s",
                *(fold_id, outcome["status"], stage),
                extra={"fold": fold_id},
            )
        if epoch != 0:
            try:
                outcome["bytes"] = self._retry_unless_cancelled(
                    fold_id, epoch, lambda: self._store.folders.keep(fold_id, epoch)
                )
            except JobCancelledError:
                self._release(worker)
                return {**self._stopped(fold_id, epoch), "epoch": known}
        return outcome

    def finish(self, fold_id: str, outcome: Outcome, worker: str) -> None:
        """Store the result of a fold in its row, or clean up after a deleted one."""
        self._release(worker)
        if self._store.folders.storage is None:
            self._close(fold_id)
        known = self.retry_until_available(
            lambda: self._store.finish(
                fold_id,
                outcome["status"],
                summary=outcome["summary"],
                error=outcome["error"],
                repeatable=outcome["repeatable"],
                kept=outcome["epoch"],
                size=outcome["bytes"],
            )
        )
        if not known:
            self.retry_until_available(lambda: self._store.folders.remove(fold_id))
        elif outcome["status"] != "cancelled":
            self.retry_until_available(lambda: self._store.folders.leave(fold_id, outcome["epoch"]))
        else:
            # Who has cancelled it wants the worker for something else: no waiting.
            with contextlib.suppress(StorageError, SQLAlchemyError, NoSuchFoldError):
                self._store.folders.leave(fold_id, outcome["epoch"])
                sweep_cancelled_of(self._store, self._store.fold(fold_id).visitor)

    def place(self, fold_id: str) -> tuple[str, int]:
        """Return the queue and the priority of a fold that was put back."""
        with contextlib.suppress(NoSuchFoldError):
            row = self._store.fold(fold_id)
            return place_of(row.turn, row.cost_s)
        return place_of(0, 0.0)  # it was deleted, which whoever takes it notices

    def retry_until_available(self, do: Callable[[], Answer]) -> Answer:
        """Run ``retry_until_available``; block for good once the worker stops."""
        return retry_until_available(do, wait=self._wait)

    def _retry_unless_cancelled(self, fold_id: str, epoch: int, do: Callable[[], Answer]) -> Answer:
        """Run ``retry_until_available``, but give up on a cancelled fold.

        Raises:
            JobCancelledError: When the fold was cancelled or taken over meanwhile.
        """

        def wait(seconds: float) -> None:
            self._wait(seconds)
            with contextlib.suppress(SQLAlchemyError):
                if not self._store.report(fold_id, epoch):
                    raise JobCancelledError(fold_id)

        return retry_until_available(do, wait=wait)

    def _wait(self, seconds: float) -> None:
        self._stopping.wait(seconds)
        self._block_until_exit()

    def _block_until_exit(self) -> None:
        """Block this thread for good once the worker stops, so that no result is recorded.

        The step was cut off by us: it must not have a result, so that the job goes on later.
        """
        if self._stopping.is_set():
            threading.Event().wait()

    @staticmethod
    def failure(error: Exception, stage: str | None) -> Outcome:
        """Return the outcome of an error of the service itself."""
        return _outcome(
            "failed",
            error={
                "code": "internal",
                "detail": f"an error occurred inside the service ({type(error).__name__}); "
                "try again.",
                "where": stage,
            },
            repeatable=False,
        )

    def _run(self, fold_id: str, stage: str, worker: str, known: int, epoch: int) -> Outcome:
        directory = self._retry_unless_cancelled(
            fold_id, epoch, lambda: self._store.folders.bring(fold_id, known, epoch)
        )
        spent_s = self.retry_until_available(lambda: self._store.stage_s(fold_id))
        done = _Progress(self._store, fold_id, stage, epoch, spent_s)
        progress = JobProgress(done.report)
        part = self._slices.get(worker)
        if part is None:
            part = self.retry_until_available(lambda: Slice(self._store, fold_id, epoch))
            self._slices[worker] = part
        with _keeping(self._store, fold_id, epoch):
            result = self._call(
                worker,
                stage,
                directory,
                on_progress=done.take,
                cancelled=lambda: progress.cancelled() or part.over(),
            )
        done.take_end()
        wanted = self.retry_until_available(progress.last)
        # A stage that was told to stop may have a result all the same, of what there was by then.
        if part.ended and wanted and self.retry_until_available(part.pause):
            raise PausedError(fold_id)
        if part.ended or result.get("status") == "cancelled" or not wanted:
            return self._stopped(fold_id, epoch)
        if stage == "read":
            self.retry_until_available(
                lambda: self._store.describe(
                    fold_id,
                    name=str(result["name"]),
                    modules=int(result["modules"]),
                    module=str(result["module"]),
                )
            )
        if stage == STAGES[-1]:
            status = "verified" if result.get("status") == "verified" else "failed"
            error = None
            if status == "failed":
                reason = str(result.get("reason") or "the plan could not be verified.")
                error = {"code": "not-verified", "detail": reason, "where": None}
            return _outcome(status, summary=result, error=error)
        # A plan that the certificate has refused is tried again in another way, a few times.
        following = result.get("again") or STAGES[STAGES.index(stage) + 1]
        return _outcome("running", ended=False, following=following)

    def _call(
        self,
        worker: str,
        stage: str,
        directory: Path,
        *,
        on_progress: Callable[[dict[str, Any]], None],
        cancelled: Callable[[], bool],
    ) -> dict[str, Any]:
        """Compute a stage in the child of an execution; one that dies gets a successor.

        Raises:
            InputError: If the input is at fault.
            ChildError: If a limit was exceeded, or ``MAX_CRASHES`` children died.
        """
        deaths = 0
        while True:
            child = self._taken.get(worker)
            if child is None:
                child = self._taken[worker] = self._children.take()
            try:
                return child.call(
                    stage,
                    directory,
                    wall_s=self._settings.stage_seconds,
                    on_progress=on_progress,
                    cancelled=cancelled,
                )
            except ChildError as error:
                self._block_until_exit()
                if error.code not in (CRASHED, LOST):
                    raise
                self._release_child(worker)
                deaths += error.code == CRASHED
                if deaths == MAX_CRASHES:
                    detail = f"{error.detail} This happened {deaths} times in the stage '{stage}'."
                    raise ChildError(CRASHED, detail) from None
                log.warning("stage=%s directory=%s restarts: %s", stage, directory, error)
            self._wait(RETRY_INTERVAL_S)
            if cancelled():
                return {"status": "cancelled", "reason": "cancelled"}

    def _advised(self, fold_id: str, error: InputError) -> InputError:
        """Return the refusal, with shapes that a refold may end in instead."""
        if error.code != "refold-differs":
            return error
        start = json.loads((self._store.folders.place(fold_id) / START_CHAIN).read_bytes())
        return Gallery().advised(error, str(start["module"]), int(start["modules"]))

    def _stopped(self, fold_id: str, epoch: int | None) -> Outcome:
        """Return the outcome of a fold that must not continue here, with the reason."""
        try:
            row = self.retry_until_available(lambda: self._store.fold(fold_id))
        except NoSuchFoldError:
            return _outcome("cancelled")
        if row.over:  # a step that is repeated after its end was noted
            return _outcome(row.status, summary=row.summary, error=row.error)
        if epoch is not None and row.epoch != epoch and not row.cancel_requested:
            log.warning("fold %s was taken over by %s", fold_id, row.worker)
            raise LeaseLostError(fold_id)
        return _outcome("cancelled", repeatable=False)

    def _close(self, fold_id: str) -> None:
        """Close the timeline of a stage that was killed before it could."""
        path = result(self._store.folders.place(fold_id), TIMELINE)
        with contextlib.suppress(TimelineError, OSError, ValueError, KeyError):
            if Timeline.open(path).status == "growing":
                TimelineWriter.reopen(path).close("failed")

    def _looked_back(self, fold_id: str) -> dict[str, Any]:
        """Return the last known state of a fold that did not finish: its frame and its attempts."""
        try:
            # The physics: only when a fold's end was missed.
            from planner.pipeline.workspace import Workspace

            return Workspace(self._store.folders.place(fold_id)).settle()
        except Exception:
            log.exception("fold %s cannot be read", fold_id, extra={"fold": fold_id})
            return {}

    def _release(self, worker: str) -> None:
        """Forget an execution, and end its child."""
        self._slices.pop(worker, None)
        self._release_child(worker)

    def _release_child(self, worker: str) -> None:
        child = self._taken.pop(worker, None)
        if child is not None:
            self._children.release(child)


@contextlib.contextmanager
def _keeping(store: Store, fold_id: str, epoch: int) -> Generator[None]:
    """Upload growing files while a stage computes, so that other machines see them."""
    folders = store.folders
    if folders.storage is None:
        yield
        return
    over = threading.Event()

    def keep() -> None:
        shown = False
        while True:
            try:
                folders.keep(fold_id, epoch)
                if not shown:
                    store.show(fold_id, epoch)
                    shown = True
            except (StorageError, SQLAlchemyError, OSError) as error:
                log.warning(
                    "fold %s could not be stored yet: %s",
                    fold_id,
                    error,
                    extra={"fold": fold_id},
                )
            if over.wait(UPLOAD_INTERVAL_S):
                return

    thread = threading.Thread(target=keep, name="keeping", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


class _Progress:
    """Progress of a stage as its row stores it."""

    def __init__(
        self, store: Store, fold_id: str, stage: str, epoch: int, spent_s: dict[str, float]
    ) -> None:
        self._store = store
        self._spent_s = spent_s
        self._began_at = time.time()
        self._fold_id = fold_id
        self._epoch = epoch
        self._place = store.folders.place(fold_id)
        self._progress: dict[str, Any] = {
            "stage": stage,
            "fraction": 0.0,
            "steps": 0,
            "steps_per_second": 0.0,
            "simulated_s": 0.0,
            "message": "getting ready" if stage in STAGES[:2] else "",
            "plan": 0,
            "plans": 0,
        }
        self._waits = True

    def take(self, event: dict[str, Any]) -> None:
        """Process an event of the child."""
        self._progress = {key: event[key] for key in self._progress}
        self._waits = True

    def take_end(self) -> None:
        """The child is done: what it has made, and how long it took, is reported once more."""
        stage = self._progress["stage"]
        took_s = time.time() - self._began_at
        self._spent_s[stage] = round(self._spent_s.get(stage, 0.0) + took_s, 3)
        self._began_at = time.time()
        self._waits = True

    def report(self) -> bool:
        """Send pending reports; False if the fold is no longer wanted."""
        progress = {
            **self._progress,
            "frames": frames_promised(self._place),
            "stage_s": self._spent_s,
            "began_at": self._began_at,
        }
        going = self._store.report(self._fold_id, self._epoch, progress if self._waits else None)
        self._waits = False
        return going
