"""Movie jobs: computation of movies by a worker.

Another worker may repeat a job whose worker has disappeared, even if that one is still running.
Each job therefore writes a file with its own name, moves it into place atomically, and only then
changes its row to ``ready``.
"""

from __future__ import annotations

import contextlib
import logging
import os
from pathlib import Path
from typing import Any, Final

import sqlalchemy as sa

from foldback.planner.errors import DamagedError, InputError
from foldback.planner.pipeline.fold_layout import is_on_table, result_path
from foldback.planner.storage.file_names import TIMELINE
from foldback.planner.verification.integrity import check
from foldback.server.errors import UNEXPECTED_WORDS, Damaged
from foldback.server.jobs.movies import INTERRUPTED
from foldback.server.jobs.progress import JobProgress
from foldback.server.jobs.queue import MAX_LOSSES, MovieClaim
from foldback.server.jobs.retry import retry_until_available
from foldback.server.processes.children import ChildError
from foldback.server.processes.limits import ChildLimits
from foldback.server.processes.movie_task import ask_for_movie, check_movie, run_movie
from foldback.server.processes.scratch import Scratch
from foldback.server.settings import Settings
from foldback.server.store.folds import NoSuchFoldError, Store
from foldback.server.store.schema import UNFINISHED_MOVIE_STATUSES, MovieRow, movie_file
from foldback.web.movies.movie import Movie

MOVIE_FILE: Final = "movie"
log = logging.getLogger("foldback.worker")


class MovieJobs:
    """Movie jobs of one worker."""

    def __init__(self, settings: Settings, store: Store) -> None:
        self._settings = settings
        self._store = store
        self._scratch = Scratch(settings.scratch_dir)
        self._scratch.sweep()

    def make(self, claim: MovieClaim) -> None:
        """Create one movie. Errors are stored in its row instead of raised."""
        fold_id, movie_id, job = claim.fold_id, claim.movie_id, claim.job
        if claim.losses >= MAX_LOSSES:
            self._fail(job, INTERRUPTED["code"], INTERRUPTED["detail"], None)
            return
        try:
            self._make(fold_id, job)
        except (InputError, ChildError) as error:
            place = error.where if isinstance(error, InputError) else None
            self._fail(job, error.code, error.detail, place)
        except DamagedError as error:
            damaged = Damaged.of(error)
            self._fail(job, damaged.code, damaged.detail, str(error.path))
        except NoSuchFoldError:
            log.info("a movie's fold was deleted")
        except Exception:
            log.exception("movie %s of fold %s failed", movie_id, fold_id)
            self._fail(job, "internal", UNEXPECTED_WORDS, None)
        self._clear_up(fold_id, job)

    def _make(self, fold_id: str, job: str) -> None:
        row = retry_until_available(lambda: self._row(job))
        if row is None or row.status not in UNFINISHED_MOVIE_STATUSES:
            return  # it is no longer wanted, or already exists
        movie = Movie.of(row.wishes)
        check_movie(movie.format)
        with self._scratch.directory() as place:
            progress = JobProgress(lambda fields: self._report(job, fields), {"steps": 0})
            if not retry_until_available(progress.last):
                return
            files = retry_until_available(lambda: self._store.directory(fold_id))
            check(files, TIMELINE)
            timeline = result_path(files, TIMELINE)
            ask_for_movie(place, row.wishes, timeline, MOVIE_FILE, on_table=is_on_table(files))

            def take(event: dict[str, Any]) -> None:
                progress.take(event)
                with contextlib.suppress(OSError):
                    os.utime(files)  # so that the copy in use is not deleted

            is_complete = run_movie(
                place,
                ChildLimits.of(self._settings),
                wall_s=self._settings.movie_seconds,
                on_progress=take,
                cancelled=progress.cancelled,
            )
            if is_complete and self._kept(fold_id, job, movie, place / MOVIE_FILE):
                log.info("created a movie of %d images", movie.count)

    def _report(self, job: str, fields: dict[str, Any] | None) -> bool:
        """Store the number of drawn pictures; return False if the movie is no longer wanted."""
        if fields is None:
            return self._store.scalar(_making(job)) is not None
        return self._update(job, status="running", frames_done=int(fields["steps"]))

    def _row(self, job: str) -> MovieRow | None:
        return self._store.scalar(sa.select(MovieRow).where(MovieRow.job == job))

    def _kept(self, fold_id: str, job: str, movie: Movie, path: Path) -> bool:
        """Publish a finished movie; return False if it is no longer wanted."""
        ready = {"status": "ready", "frames_done": movie.count, "bytes": path.stat().st_size}

        def keep() -> bool:
            if self._store.scalar(_making(job)) is None:
                return False
            self._store.folders.keep_movie(fold_id, movie_file(job), path)
            return True

        return retry_until_available(keep) and retry_until_available(
            lambda: self._update(job, problem=None, **ready)
        )

    def _fail(self, job: str, code: str, detail: str, place: str | None) -> None:
        log.warning("a movie failed: %s", detail)
        problem = {"code": code, "detail": detail, "where": place}
        retry_until_available(lambda: self._update(job, status="failed", problem=problem))

    def _update(self, job: str, **values: Any) -> bool:
        """Change the row of an unfinished movie; return False if there is none."""
        changed = sa.update(MovieRow).where(
            MovieRow.job == job, MovieRow.status.in_(UNFINISHED_MOVIE_STATUSES)
        )
        return bool(self._store.change(changed.values(**values)))

    def _clear_up(self, fold_id: str, job: str) -> None:
        """Delete the files of the movie, or of its fold, if it was deleted meanwhile."""

        def clear() -> None:
            if self._row(job) is not None:
                return
            try:
                self._store.fold(fold_id)
            except NoSuchFoldError:
                with contextlib.suppress(NoSuchFoldError):
                    self._store.folders.remove(fold_id)
            else:
                self._store.folders.remove_movie(fold_id, movie_file(job))

        retry_until_available(clear)


def _making(job: str) -> sa.Select[str]:
    return sa.select(MovieRow.id).where(
        MovieRow.job == job, MovieRow.status.in_(UNFINISHED_MOVIE_STATUSES)
    )
