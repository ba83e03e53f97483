"""Runner: computes the stages of folds in child processes and keeps their rows up to date."""

from __future__ import annotations

import contextlib
import json
import logging
import shutil
import threading
import time
from typing import Any, Final, TypedDict

from planner.errors import InputError, TimelineError
from planner.timeline import Timeline, TimelineWriter
from planner.unfolding import START_CHAIN
from server.children import Child, ChildError, Children
from server.gallery import Gallery
from server.limits import ChildLimits
from server.settings import Settings
from server.store import NoSuchFoldError, Store

STAGES: Final = ("read", "explode", "play_back", "certify", "export")
REPORT_EVERY_S: Final = 0.2
log = logging.getLogger("foldback.worker")


class Outcome(TypedDict):
    """How a stage ended; ``ended`` tells that the fold ends with it, ``following`` what is next."""

    ended: bool
    following: str | None
    status: str
    summary: dict[str, Any]
    error: dict[str, Any] | None
    repeatable: bool


def _outcome(
    status: str,
    *,
    ended: bool = True,
    following: str | None = None,
    summary: dict[str, Any] | None = None,
    error: dict[str, Any] | None = None,
    repeatable: bool = True,
) -> Outcome:
    return {
        "ended": ended,
        "following": following,
        "status": status,
        "summary": summary or {},
        "error": error,
        "repeatable": repeatable,
    }


class Runner:
    """Holds one child for each fold that is being computed."""

    def __init__(self, settings: Settings, store: Store) -> None:
        self._settings = settings
        self._store = store
        self._children = Children("stages", ChildLimits.of(settings))
        self._taken: dict[str, Child] = {}
        self._stopping = threading.Event()

    def prewarm(self) -> None:
        """Has a child ready for the next fold."""
        self._children.prewarm()

    def stop(self) -> None:
        """Ends all children; their folds stay as they are and go on with the next start."""
        self._stopping.set()
        self._children.close()

    def run(self, fold_id: str, stage: str) -> Outcome:
        """Computes one stage of a fold. Whatever goes wrong is an outcome, not an exception."""
        try:
            outcome = self._run(fold_id, stage)
        except InputError as error:
            error = self._advised(fold_id, error)
            outcome = _outcome(
                "failed",
                error={"code": error.code, "detail": error.detail, "where": error.where},
            )
        except ChildError as error:
            self._release(fold_id)
            outcome = _outcome(
                "failed",
                error={"code": error.code, "detail": error.detail, "where": stage},
                repeatable=False,
            )
        except Exception as error:
            log.exception("fold %s failed in stage %s", fold_id, stage, extra={"fold": fold_id})
            outcome = self.failure(error, stage)
        if self._stopping.is_set():
            # The child was ended by us: say nothing, so that the job goes on after a restart.
            threading.Event().wait()
        if outcome["ended"]:
            log.info(
                "fold %s: %s in stage %s",
                *(fold_id, outcome["status"], stage),
                extra={"fold": fold_id},
            )
        return outcome

    def finish(self, fold_id: str, outcome: Outcome) -> None:
        """Notes the end of a fold in its row, or clears up after one that was deleted."""
        self._release(fold_id)
        self._close(fold_id)
        known = self._store.finish(
            fold_id,
            outcome["status"],
            summary=outcome["summary"],
            error=outcome["error"],
            repeatable=outcome["repeatable"],
        )
        if not known:
            shutil.rmtree(self._store.directory(fold_id), ignore_errors=True)
        self.prewarm()

    @staticmethod
    def failure(error: Exception, stage: str | None) -> Outcome:
        """The outcome when the service itself went wrong."""
        return _outcome(
            "failed",
            error={
                "code": "internal",
                "detail": f"something went wrong inside the service ({type(error).__name__}); "
                "try again.",
                "where": stage,
            },
            repeatable=False,
        )

    def _run(self, fold_id: str, stage: str) -> Outcome:
        if not self._store.begin(fold_id, stage):
            return self._stopped(fold_id)
        child = self._taken.get(fold_id)
        if child is None:
            child = self._taken[fold_id] = self._children.take()
        if stage == "certify":
            self.prewarm()  # by the time this fold is over, the next one's child is ready
        news = _News(self._store, fold_id, stage)
        result = child.call(
            stage,
            self._store.directory(fold_id),
            wall_s=self._settings.stage_seconds,
            on_progress=news.take,
            cancelled=news.cancelled,
        )
        if result.get("status") == "cancelled" or not news.last():
            return self._stopped(fold_id)
        if stage == "read":
            self._store.describe(
                fold_id,
                name=str(result["name"]),
                modules=int(result["modules"]),
                module=str(result["module"]),
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

    def _advised(self, fold_id: str, error: InputError) -> InputError:
        """The refusal, with shapes that a refold could lead to instead."""
        if error.code != "refold-differs":
            return error
        start = json.loads((self._store.directory(fold_id) / START_CHAIN).read_bytes())
        return Gallery().advised(error, str(start["module"]), int(start["modules"]))

    def _stopped(self, fold_id: str) -> Outcome:
        try:
            row = self._store.fold(fold_id)
        except NoSuchFoldError:
            return _outcome("cancelled")
        if row.over:  # a step that is repeated after its end was noted
            return _outcome(row.status, summary=row.summary, error=row.error)
        return _outcome("cancelled", repeatable=False)

    def _close(self, fold_id: str) -> None:
        """Closes the timeline of a stage that was ended before it could."""
        path = self._store.directory(fold_id) / "timeline.zarr"
        with contextlib.suppress(TimelineError, OSError, ValueError, KeyError):
            if Timeline.open(path).status == "growing":
                TimelineWriter.reopen(path).close("failed")

    def _release(self, fold_id: str) -> None:
        child = self._taken.pop(fold_id, None)
        if child is not None:
            self._children.release(child)


class _News:
    """Carries progress to the row, and the wish to cancel back, both at a bounded pace."""

    def __init__(self, store: Store, fold_id: str, stage: str) -> None:
        self._store = store
        self._fold_id = fold_id
        self._progress: dict[str, Any] = {
            "stage": stage,
            "fraction": 0.0,
            "steps": 0,
            "steps_per_second": 0.0,
            "message": "getting ready" if stage == STAGES[0] else "",
        }
        self._waits = True
        self._going = True
        self._at = 0.0

    def take(self, event: dict[str, Any]) -> None:
        """News from the child."""
        self._progress = {key: event[key] for key in self._progress}
        self._waits = True

    def cancelled(self) -> bool:
        """Whether the fold is not wanted any more, as of the last report."""
        if time.monotonic() - self._at >= REPORT_EVERY_S:
            self.last()
        return not self._going

    def last(self) -> bool:
        """Reports what waits; False when the fold is not wanted any more."""
        self._going = self._store.report(self._fold_id, self._progress if self._waits else None)
        self._waits = False
        self._at = time.monotonic()
        return self._going
