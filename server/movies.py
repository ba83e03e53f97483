"""Movies: those that were asked for, each in a directory of its fold named after its wishes.

``request.json`` says what is wanted, by whom, and the name of its job; ``progress.json``,
``problem.json`` and the movie are the worker's answers. Deleting the request stops the work.
"""

from __future__ import annotations

import hmac
import json
import shutil
import threading
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, Literal

from planner.errors import InputError
from planner.files import write_whole
from server.jobs import Jobs
from server.problems import Problem
from server.settings import Settings
from server.store import Store, hash_of, new_id, new_token
from web.movie import Movie

Status = Literal["queued", "running", "ready", "failed"]
RETRY_AFTER_S: Final = 10
LOST: Final = {
    "code": "interrupted",
    "detail": "making this movie was broken off; ask for it again.",
    "where": None,
}


class NoSuchMovieError(LookupError):
    """There is no movie with this id."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MovieRequest:
    """One movie that is wanted.

    Attributes:
        movie: What it is to be.
        timeline: Path of the timeline's directory.
        job: Name of the job that makes it.
        visitor: Who asked first.
        token_hash: Of what whoever asked first got for deleting it.
    """

    movie: Movie
    timeline: str
    job: str
    visitor: str
    token_hash: str

    @property
    def part(self) -> str:
        """Name of the file while it is being made."""
        return f"{self.job}.part"


@dataclass(frozen=True, slots=True, kw_only=True)
class MovieState:
    """A movie as it is now."""

    id: str
    movie: Movie
    token_hash: str
    status: Status
    frames_done: int
    problem: dict[str, Any] | None = None

    def owned_by(self, token: str) -> bool:
        """Whether this is the token that came with the answer to the wish."""
        return hmac.compare_digest(self.token_hash, hash_of(token))


class Movies:
    """The service's end of movies. Safe to use from many threads."""

    def __init__(self, settings: Settings, store: Store, jobs: Jobs) -> None:
        self._settings = settings
        self._store = store
        self._jobs = jobs
        self._lock = threading.RLock()

    def ask(self, fold_id: str, movie: Movie, visitor: str) -> tuple[MovieState, str | None]:
        """Has a movie made, unless it is there or on its way. One that failed is tried again.

        Returns:
            The movie, and the token with which it may be deleted; None when somebody asked before.

        Raises:
            NoSuchFoldError: When there is no such fold.
            Problem: When the fold has no timeline (404) or is not over (409), or there is too much
                to do already (429, 503), or no room (507).
        """
        row = self._store.fold(fold_id)
        directory = self._store.directory(fold_id)
        timeline = directory / "timeline.zarr"
        if not row.over:
            raise Problem(
                409,
                "not-ready",
                f"the fold is {row.status}; a movie can be made once it is over.",
                headers={"Retry-After": str(RETRY_AFTER_S)},
            )
        if not (timeline / "zarr.json").is_file():
            raise Problem(404, "no-such-artifact", "This fold ended without a timeline to film.")
        place, token = directory / "movies" / movie.key, None
        with self._lock:
            try:
                state = self.state(fold_id, movie.key)
            except NoSuchMovieError:
                state = None
            if state is None or state.status == "failed":
                self._check_room(visitor)
                self._forget_oldest(directory / "movies")
                shutil.rmtree(place, ignore_errors=True)
                token = new_token()
                request = MovieRequest(
                    movie=movie,
                    timeline=str(timeline),
                    job=f"{fold_id}.{movie.key}.{new_id()}",
                    visitor=visitor,
                    token_hash=hash_of(token),
                )
                _keep(place, request)
                self._jobs.enqueue_movie(request.job, fold_id, movie.key)
        return self.state(fold_id, movie.key), token

    def state(self, fold_id: str, movie_id: str) -> MovieState:
        """How far a movie is.

        Raises:
            NoSuchFoldError: When this is not the id of a fold.
            NoSuchMovieError: When there is no such movie.
        """
        place = self._place(fold_id, movie_id)
        state = state_of(place)
        if state.status in ("queued", "running"):
            request = request_of(place)
            if request is not None and request.job not in self._jobs.movies():
                with self._lock:  # it may just be asked for, or have come to its end
                    lost = request.job not in self._jobs.movies()
                    state = state_of(place)
                    if lost and state.status in ("queued", "running"):
                        write_whole(place / "problem.json", json.dumps(LOST).encode())
                        state = state_of(place)
        return state

    def file(self, fold_id: str, movie_id: str) -> Path | None:
        """The file of a movie, once it is there.

        Raises:
            NoSuchFoldError: When this is not the id of a fold.
            NoSuchMovieError: When there is no such movie.
        """
        place = self._place(fold_id, movie_id)
        path = file_of(place, state_of(place).movie)
        return path if path.is_file() else None

    def delete(self, fold_id: str, movie_id: str) -> None:
        """Forgets a movie, and stops the work on it.

        Raises:
            NoSuchFoldError: When this is not the id of a fold.
            NoSuchMovieError: When there is no such movie.
        """
        place = self._place(fold_id, movie_id)
        request = request_of(place)
        (place / "request.json").unlink(missing_ok=True)
        if request is not None:
            self._jobs.forget(request.job)
        shutil.rmtree(place, ignore_errors=True)

    def _place(self, fold_id: str, movie_id: str) -> Path:
        if not (movie_id.isascii() and movie_id.isalnum() and len(movie_id) <= 32):
            raise NoSuchMovieError(movie_id)
        return self._store.directory(fold_id) / "movies" / movie_id

    def _check_room(self, visitor: str) -> None:
        settings = self._settings
        waiting = [found for job in self._jobs.movies() if (found := self._visitor_of(job))]
        own = waiting.count(visitor)
        again = {"Retry-After": str(RETRY_AFTER_S)}
        if own >= settings.movies_waiting_of_visitor:
            raise Problem(
                429,
                "too-many-movies",
                f"{own} movies of yours are being made, which is the most there may be; wait for "
                "one, or delete it.",
                headers=again,
            )
        if len(waiting) >= settings.movies_waiting:
            raise Problem(
                503,
                "busy",
                f"{len(waiting)} movies are being made for others; try again in {RETRY_AFTER_S} s.",
                headers=again,
            )
        if shutil.disk_usage(settings.root).free < settings.min_free_disk_bytes:
            raise Problem(507, "no-room", "The disk of the service is nearly full; try later.")

    def _visitor_of(self, job: str) -> str | None:
        """Who asked for a job; None when nobody wants it any more."""
        fold_id, movie_id, _ = job.split(".")
        request = request_of(self._place(fold_id, movie_id))
        return request.visitor if request is not None and request.job == job else None

    def _forget_oldest(self, movies: Path) -> None:
        """Makes room for one more."""
        over = [
            place
            for place in (movies.iterdir() if movies.is_dir() else ())
            if (place / "problem.json").is_file() or any(place.glob("movie.*"))
        ]
        over.sort(key=lambda place: place.stat().st_mtime)
        for place in over[: max(0, len(over) + 1 - self._settings.movies_of_fold)]:
            shutil.rmtree(place, ignore_errors=True)


def request_of(place: Path) -> MovieRequest | None:
    """The request in a movie's directory, if there is one."""
    try:
        noted = json.loads((place / "request.json").read_bytes())
        return MovieRequest(
            movie=Movie.of(noted["movie"]),
            timeline=noted["timeline"],
            job=noted["job"],
            visitor=noted["visitor"],
            token_hash=noted.get("token_hash", ""),
        )
    except (OSError, ValueError, KeyError, InputError):
        return None


def file_of(place: Path, movie: Movie) -> Path:
    """Where a movie's file is once it is whole."""
    return place / f"movie.{movie.format}"


def state_of(place: Path) -> MovieState:
    """What a movie's directory says.

    Raises:
        NoSuchMovieError: When there is no movie in it.
    """
    request = request_of(place)
    if request is None:
        raise NoSuchMovieError(place.name)
    movie = request.movie
    problem, progress = _read(place / "problem.json"), _read(place / "progress.json")
    done, status = 0, "queued"
    if file_of(place, movie).is_file():
        done, status, problem = movie.count, "ready", None
    elif problem is not None:
        status = "failed"
    elif progress is not None:
        done, status = int(progress["frames_done"]), "running"
    return MovieState(
        id=place.name,
        movie=movie,
        token_hash=request.token_hash,
        status=status,
        frames_done=done,
        problem=problem,
    )


def _keep(place: Path, request: MovieRequest) -> None:
    try:
        place.mkdir(parents=True, exist_ok=True)
        noted = {**asdict(request), "part": request.part}
        write_whole(place / "request.json", json.dumps(noted).encode())
    except OSError as error:
        raise Problem(
            507, "no-room", f"The movie has no room ({error.strerror}); try later."
        ) from error


def _read(path: Path) -> dict[str, Any] | None:
    try:
        return json.loads(path.read_bytes())
    except (OSError, ValueError):
        return None
