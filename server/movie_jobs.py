"""Movie jobs: the worker's end of movies."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import shutil
import time
from pathlib import Path
from typing import Any, Final

from planner.errors import InputError
from planner.files import write_whole
from server.children import ChildError
from server.filming import film
from server.limits import ChildLimits
from server.movies import MovieRequest, file_of, request_of
from server.settings import Settings
from server.store import NoSuchFoldError, Store

REPORT_EVERY_S: Final = 0.2
log = logging.getLogger("foldback.worker")


class MovieJobs:
    """Makes the movies of a queue."""

    def __init__(self, settings: Settings, store: Store) -> None:
        self._settings = settings
        self._store = store

    def make(self, fold_id: str, movie_id: str, job: str) -> None:
        """Makes one movie. What goes wrong is written beside it; nothing is raised."""
        try:
            place = self._store.directory(fold_id) / "movies" / movie_id
        except NoSuchFoldError:
            return
        request = request_of(place)
        if request is None or request.job != job:
            return  # nobody wants it any more
        try:
            self._make(place, request)
        except (InputError, ChildError) as error:
            where = error.where if isinstance(error, InputError) else None
            self._fail(place, request, error.code, error.detail, where)
        except Exception as error:
            about = {"fold": fold_id, "movie": movie_id}
            log.exception("movie %s of fold %s failed", movie_id, fold_id, extra=about)
            words = f"something went wrong inside the service ({type(error).__name__}); try again."
            self._fail(place, request, "internal", words, None)
        finally:
            (place / request.part).unlink(missing_ok=True)
            if not (place / "request.json").exists():
                shutil.rmtree(place, ignore_errors=True)

    def _make(self, place: Path, request: MovieRequest) -> None:
        at = 0.0

        def report(event: dict[str, Any]) -> None:
            nonlocal at
            if time.monotonic() - at >= REPORT_EVERY_S:
                at = time.monotonic()
                _write(place, request, "progress.json", {"frames_done": event["steps"]})

        _write(place, request, "progress.json", {"frames_done": 0})
        whole = film(
            place,
            ChildLimits.of(self._settings),
            wall_s=self._settings.movie_seconds,
            on_progress=report,
            cancelled=lambda: not _wanted(place, request),
        )
        if whole and _wanted(place, request):
            os.replace(place / request.part, file_of(place, request.movie))
            log.info("a movie of %d pictures is made", request.movie.count)

    def _fail(
        self, place: Path, request: MovieRequest, code: str, detail: str, where: str | None
    ) -> None:
        log.warning("a movie failed: %s", detail)
        problem = {"code": code, "detail": detail, "where": where}
        _write(place, request, "problem.json", problem)


def _wanted(place: Path, request: MovieRequest) -> bool:
    found = request_of(place)
    return found is not None and found.job == request.job


def _write(place: Path, request: MovieRequest, name: str, value: dict[str, Any]) -> None:
    if _wanted(place, request):
        with contextlib.suppress(OSError):  # deleted this very moment
            write_whole(place / name, json.dumps(value).encode())
