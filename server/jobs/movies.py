"""Movies: requested movies, each a row named after its options.

The row contains the options, the visitor, the name of the job and its progress. Deleting the row
stops the job (``server/jobs/movie_runner.py``).
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Final

import sqlalchemy as sa
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from foldback.planner.pipeline.fold_layout import result_path
from foldback.planner.storage.array_files import HEAD
from foldback.planner.storage.file_names import TIMELINE
from foldback.planner.verification.integrity import check
from foldback.server.errors import Conflict, NoSuch, NotFound, TooMany, Unavailable
from foldback.server.limits.concurrency_quota import Holder, network_share
from foldback.server.limits.disk_space import check_space
from foldback.server.limits.networks import networks_of
from foldback.server.settings import Settings
from foldback.server.store.folds import Store, new_id
from foldback.server.store.object_store import StorageError
from foldback.server.store.owner import Owner, owned_by
from foldback.server.store.schema import UNFINISHED_MOVIE_STATUSES, FoldRow, MovieRow, movie_file
from foldback.web.movies.movie import Movie

MOVIE_RETRY_S: Final = 10
"""Value of the ``Retry-After`` header, in s, if a movie is requested while its fold is unfinished
or while too many movies wait. A smaller value brings more requests that are refused again."""
INTERRUPTED: Final = {
    "code": "interrupted",
    "detail": "this movie was interrupted; request it again.",
}
"""Problem of a movie whose file is missing, or whose workers have died too often."""

log = logging.getLogger("foldback.service")


class NoSuchMovieError(NoSuch):
    """There is no movie with this id."""

    def __init__(self, movie_id: str) -> None:
        super().__init__(
            "no-such-movie", "This movie does not exist or has expired; request it again."
        )


class Movies:
    """Requests for movies. Safe for use by several threads and processes."""

    def __init__(self, settings: Settings, store: Store) -> None:
        self._settings = settings
        self._store = store

    def ask(
        self,
        fold_id: str,
        movie: Movie,
        visitor: str,
        *,
        owner: Owner,
        of_owner: bool = False,
    ) -> tuple[MovieRow, bool]:
        """Request a movie, unless it exists or is being created. A failed one is tried again.

        Args:
            fold_id: The fold.
            movie: Options of the movie.
            visitor: Visitor that requests it.
            owner: Owner of the movie, if it is a new one.
            of_owner: True for the fold's owner, whose movies others do not displace.

        Returns:
            The movie, and True if it is a new one.

        Raises:
            NoSuchFoldError: If there is no such fold.
            ServiceError: If the fold has no timeline or is not over, too many movies wait, or the
                disk is full.
        """
        row = self._store.fold(fold_id)
        if not row.over:
            raise Conflict(
                "not-ready",
                "the fold is {status}; movies can be created once it has finished.",
                retry_after_s=MOVIE_RETRY_S,
                status=row.status,
            )
        check(self._store.directory(fold_id), TIMELINE)
        if not (result_path(self._store.directory(fold_id), TIMELINE) / HEAD).is_file():
            raise NotFound(
                "no-such-artifact", "This fold has no frames, so it cannot have a movie."
            )
        new_row = MovieRow(
            fold_id=fold_id,
            id=movie.key,
            job=f"{fold_id}.{movie.key}.{new_id()}.{movie.format}",
            wishes=asdict(movie),
            visitor=visitor,
            token_hash=owner.digest,
            status="queued",
            frames_done=0,
            created_at=time.time(),
            of_owner=of_owner,
        )
        try:
            self._add(new_row)
        except IntegrityError:  # it exists already, or the fold was deleted
            self._store.fold(fold_id)
            if of_owner:
                self._take_over(fold_id, movie.key)
            return self.state(fold_id, movie.key), False
        return new_row, True

    def state(self, fold_id: str, movie_id: str) -> MovieRow:
        """Return the row of a movie.

        Raises:
            NoSuchMovieError: If there is no such movie.
        """
        row = self._store.get(MovieRow, (fold_id, movie_id))
        if row is None:
            raise NoSuchMovieError(movie_id)
        return row

    def made(self, owner: Owner) -> list[tuple[MovieRow, FoldRow]]:
        """Return the movies that an owner has requested, each with its fold, newest first."""
        of_own_fold = sa.and_(owned_by(owner), MovieRow.of_owner)
        query = (
            sa.select(MovieRow, FoldRow)
            .join(FoldRow, FoldRow.id == MovieRow.fold_id)
            .where(sa.or_(owned_by(owner, MovieRow.token_hash), of_own_fold))
            .order_by(MovieRow.created_at.desc(), MovieRow.job)
            .limit(100)
        )
        with self._store.reading() as session:
            return [(movie, fold) for movie, fold in session.execute(query)]

    def file(self, fold_id: str, movie_id: str) -> Path | None:
        """Return the path of a movie; None if it is not finished or its file is missing.

        Raises:
            NoSuchMovieError: If there is no such movie.
            StorageError: If the storage does not answer.
        """
        row = self.state(fold_id, movie_id)
        if row.status != "ready":
            return None
        path = self._store.folders.movie(fold_id, row.file)
        if path is None:
            self._store.change(
                sa.update(MovieRow)
                .where(MovieRow.job == row.job, MovieRow.status == "ready")
                .values(status="failed", problem={**INTERRUPTED, "where": None}, bytes=0)
            )
        return path

    def delete(self, fold_id: str, movie_id: str) -> None:
        """Delete a movie, and stop its job.

        Raises:
            NoSuchMovieError: If there is no such movie.
            StorageError: If the storage does not answer; the row is deleted all the same.
        """
        row = self.state(fold_id, movie_id)
        with self._store.changing() as session:
            deleted = self._delete(session, MovieRow.job == row.job)
        self._clear(deleted)

    def _add(self, new_row: MovieRow) -> None:
        with self._store.changing() as session:
            failed = self._delete(
                session,
                MovieRow.fold_id == new_row.fold_id,
                MovieRow.id == new_row.id,
                MovieRow.status == "failed",
            )
            session.add(new_row)
            session.flush()
            self._check_room(session, new_row.visitor)
            old = session.scalars(
                sa.select(MovieRow.job)
                .where(
                    MovieRow.fold_id == new_row.fold_id,
                    MovieRow.of_owner.is_(new_row.of_owner),
                    MovieRow.status.not_in(UNFINISHED_MOVIE_STATUSES),
                )
                .order_by(MovieRow.created_at.desc())
                .offset(self._settings.movies_of_fold - 1)
            ).all()
            deleted = self._delete(session, MovieRow.job.in_(old))
        try:
            self._clear([*failed, *deleted])
        except StorageError as error:  # the requested movie is queued all the same
            log.warning("files of older movies could not be deleted: %s", error)

    def _check_room(self, session: Session, visitor: str) -> None:
        """Check the limits of unfinished movies, including the one just added."""
        settings = self._settings
        making = session.scalars(
            sa.select(MovieRow.visitor).where(MovieRow.status.in_(UNFINISHED_MOVIE_STATUSES))
        ).all()
        other_movies = len(making) - 1
        share = network_share(settings.movies_waiting, settings.movies_waiting_of_visitor)
        bounds = {
            visitor: (Holder.VISITOR, settings.movies_waiting_of_visitor),
            **dict.fromkeys(networks_of(visitor), (Holder.NETWORK, share)),
        }
        for group, (holder, max_movies) in bounds.items():
            count = sum(group in (name, *networks_of(name)) for name in making) - 1
            if max_movies is not None and count >= max_movies:
                raise TooMany(
                    "too-many-movies",
                    f"{{count}} movies {holder} are being created, which is the limit; wait until "
                    "one is finished, or delete one.",
                    retry_after_s=MOVIE_RETRY_S,
                    count=count,
                )
        if other_movies >= settings.movies_waiting:
            raise Unavailable(
                "busy",
                "{count} movies for other people are being created; try again in "
                "{retry_after_s} s.",
                retry_after_s=MOVIE_RETRY_S,
                count=other_movies,
            )
        check_space(settings.root, settings.min_free_disk_bytes)

    def _take_over(self, fold_id: str, movie_id: str) -> None:
        """Make a movie the fold owner's; the visitor that requested it can no longer delete it."""
        self._store.change(
            sa.update(MovieRow)
            .where(MovieRow.fold_id == fold_id, MovieRow.id == movie_id)
            .values(of_owner=True, token_hash="")  # the digest of no token
        )

    def _delete(
        self, session: Session, *conditions: sa.ColumnElement[bool]
    ) -> list[tuple[str, str]]:
        """Delete rows; return the fold and job of each."""
        deleted = sa.delete(MovieRow).where(*conditions).returning(MovieRow.fold_id, MovieRow.job)
        return [(fold_id, job) for fold_id, job in session.execute(deleted)]

    def _clear(self, deleted: Iterable[tuple[str, str]]) -> None:
        """Remove the files of deleted rows."""
        for fold_id, job in deleted:
            self._store.folders.remove_movie(fold_id, movie_file(job))
