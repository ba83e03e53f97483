"""Rows of movies: requested by many processes, made once, and consistent after failures."""

import json
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import pytest

from foldback.planner.storage.array_files import write_head
from foldback.server.errors import TooMany, Unavailable
from foldback.server.jobs import movie_runner, progress
from foldback.server.jobs.movie_runner import MovieJobs
from foldback.server.jobs.movies import Movies, NoSuchMovieError
from foldback.server.jobs.queue import MAX_LOSSES, MovieClaim
from foldback.server.limits.networks import visitor_at
from foldback.server.settings import Settings
from foldback.server.store.folds import Store
from foldback.server.store.owner import Owner
from foldback.server.store.schema import FoldRow, MovieRow
from foldback.web.movies.movie import Movie
from tests.refusal import refused
from tests.server.rows import a_fold, new_owner

OWNER = new_owner()
MOVIES = [Movie.of({"seconds": seconds}) for seconds in (1, 2, 3, 4)]


class Process:
    """Store, artifacts and movies of one web process and its worker."""

    def __init__(self, settings: Settings) -> None:
        self.store = Store(settings)
        self.movies = Movies(settings, self.store)
        self.worker = MovieJobs(settings, self.store)
        self.settings = settings

    def close(self) -> None:
        self.store.close()

    def row(self, movie: Movie = MOVIES[0]) -> MovieRow:
        with self.store.reading() as session:
            row = session.get(MovieRow, ("a1", movie.key))
        assert row is not None
        return row

    def ask(
        self, movie: Movie, visitor: str, *, owner: Owner | None = None, of_owner: bool = False
    ) -> tuple[MovieRow, bool]:
        owner = owner or new_owner()
        return self.movies.ask("a1", movie, visitor, owner=owner, of_owner=of_owner)

    def make(self, movie: Movie = MOVIES[0]) -> None:
        self.worker.make(MovieClaim("a1", movie.key, self.row(movie).job, "worker:1"))

    def fold(self) -> FoldRow:
        return self.store.fold("a1")


Processes = Callable[..., list[Process]]


@pytest.fixture
def processes(tmp_path: Path) -> Iterator[Processes]:
    """Function that creates two processes with a finished fold."""

    def make(**settings: Any) -> list[Process]:
        site_settings = Settings(data_dir=tmp_path, **settings)
        created = [stack.enter_context(closing(Process(site_settings))) for _ in range(2)]
        store = created[0].store
        store.add(a_fold("a1", bytes=1000), OWNER)
        timeline = store.directory("a1") / "timeline"
        timeline.mkdir(parents=True)
        write_head(timeline, {"files": {}})
        return created

    with ExitStack() as stack:
        yield make


@pytest.fixture
def filming(monkeypatch: pytest.MonkeyPatch) -> dict[str, Callable[[], None]]:
    """Replace the drawing of movies by seven bytes, written after ``meanwhile`` has run."""
    acts: dict[str, Callable[[], None]] = {"meanwhile": lambda: None}

    def run_movie(
        movie_place: Path, limits: object, *, cancelled: Callable[[], bool], **movie_options: Any
    ) -> bool:
        request = json.loads((movie_place / "request.json").read_text())
        assert Path(request["timeline"], "head.json").is_file()
        acts["meanwhile"]()
        (movie_place / request["part"]).write_bytes(b"a movie")
        return not cancelled()

    monkeypatch.setattr(movie_runner, "run_movie", run_movie)
    monkeypatch.setattr(progress, "REPORT_INTERVAL_S", 0.0)
    return acts


def remaining_files(process: Process) -> list[str]:
    folder = process.settings.folds_dir / "a1" / "movies"
    return [path.name for path in folder.iterdir()] if folder.is_dir() else []


def test_movie_requested_at_once_is_one_job(processes: Processes) -> None:
    process_pair = processes()
    ready = threading.Barrier(8)

    def ask(process: Process) -> bool:
        ready.wait()
        return process.ask(MOVIES[0], "somebody")[1]

    with ThreadPoolExecutor(8) as threads:
        new = list(threads.map(ask, process_pair * 4))
    assert new.count(True) == 1
    assert process_pair[0].row().status == "queued"


def test_movies_of_one_network_leave_room_for_others(processes: Processes) -> None:
    first, second = processes(movies_waiting_of_visitor=1, movies_waiting=4)
    home = [visitor_at(f"2001:db8:1:{k}::1") for k in range(3)]
    first.ask(MOVIES[0], home[0])
    with refused("too-many-movies", kind=TooMany):
        second.ask(MOVIES[1], home[0])
    assert not second.ask(MOVIES[0], home[0])[1]  # an equal request is no other movie
    second.ask(MOVIES[1], home[1])
    with pytest.raises(TooMany, match="from your network"):
        first.ask(MOVIES[2], home[2])
    for k in range(2):
        assert first.ask(MOVIES[2 + k], visitor_at(f"2001:db8:{2 + k}::1"))[1]
    with refused("busy", kind=Unavailable):
        second.ask(Movie.of({"seconds": 5}), visitor_at("2001:db8:9::1"))


def test_repeatedly_lost_movie_fails_and_is_requested_again(processes: Processes) -> None:
    first, second = processes()
    first.ask(MOVIES[0], "somebody")
    claim = MovieClaim("a1", MOVIES[0].key, first.row().job, "worker:1", losses=MAX_LOSSES)
    first.worker.make(claim)
    state = second.movies.state("a1", MOVIES[0].key)
    assert (state.status, state.problem and state.problem["code"]) == ("failed", "interrupted")
    owner = new_owner()
    state, new = second.ask(MOVIES[0], "somebody", owner=owner)
    assert state.status == "queued"
    assert new and owner.owns(state.token_hash)


def test_movie_made_twice_counts_once(processes: Processes, filming: Any) -> None:
    first, second = processes()
    first.ask(MOVIES[0], "somebody")
    filming["meanwhile"] = lambda: filming.update(meanwhile=lambda: None) or second.make()
    first.make()  # another worker takes over and finishes first
    second.make()
    path = first.movies.file("a1", MOVIES[0].key)
    assert path is not None and path.read_bytes() == b"a movie"
    assert (first.row().bytes, remaining_files(first)) == (7, [path.name])
    assert first.fold().bytes == 1000  # movies do not count as files of the fold
    assert not list(first.settings.scratch_dir.iterdir())
    second.movies.delete("a1", MOVIES[0].key)
    assert remaining_files(first) == []


def test_movie_deleted_while_it_is_made_leaves_nothing(processes: Processes, filming: Any) -> None:
    first, second = processes()
    first.ask(MOVIES[0], "somebody")
    job = first.row().job
    filming["meanwhile"] = lambda: second.movies.delete("a1", MOVIES[0].key)
    first.make()
    assert remaining_files(first) == []
    with pytest.raises(NoSuchMovieError):
        first.movies.state("a1", MOVIES[0].key)
    first.ask(MOVIES[0], "somebody")
    old = MovieClaim("a1", MOVIES[0].key, job, "worker:1")
    first.worker.make(old)  # the old claim is no longer valid
    assert first.row().status == "queued"

    def delete_fold() -> None:
        second.store.delete("a1")
        second.store.folders.remove("a1")

    filming["meanwhile"] = delete_fold
    first.make()
    assert not (first.settings.folds_dir / "a1").exists()


def test_oldest_movie_is_removed_first(processes: Processes, filming: Any) -> None:
    first, second = processes(movies_of_fold=2)
    for movie in MOVIES:
        first.ask(movie, "somebody")
        second.make(movie)
    assert sorted(remaining_files(first)) == sorted(first.row(movie).file for movie in MOVIES[2:])
    # A movie whose file is gone is removed, and can be made again.
    second.store.folders.remove_movie("a1", first.row(MOVIES[3]).file)
    assert first.movies.file("a1", MOVIES[3].key) is None
    assert first.movies.state("a1", MOVIES[3].key).status == "failed"
    assert first.row(MOVIES[3]).bytes == 0
    assert first.ask(MOVIES[3], "somebody")[1]


def test_movies_of_strangers_do_not_displace_those_of_the_owner(
    processes: Processes, filming: Any
) -> None:
    first, second = processes(movies_of_fold=1)
    first.ask(MOVIES[0], "the owner", of_owner=True)
    second.make(MOVIES[0])
    for movie in MOVIES[1:3]:
        first.ask(movie, "a stranger")
        second.make(movie)
    assert sorted(remaining_files(first)) == sorted(
        first.row(m).file for m in (MOVIES[0], MOVIES[2])
    )
    # A stranger's movie stays, too, once the owner requests it.
    assert first.ask(MOVIES[2], "the owner", of_owner=True)[1] is False
    first.ask(MOVIES[3], "a stranger")
    second.make(MOVIES[3])
    assert len(remaining_files(first)) == 3


def test_movie_requested_by_stranger_and_owner_is_the_owners(processes: Processes) -> None:
    first, second = processes()
    stranger = new_owner()
    assert second.ask(MOVIES[0], "a stranger", owner=stranger)[1]
    movie_row, new = first.ask(MOVIES[0], "the owner", of_owner=True)
    assert not new and first.row().of_owner
    assert not stranger.owns(movie_row.token_hash)


def test_files_of_a_dead_worker_are_removed(tmp_path: Path, store: Store) -> None:
    settings = Settings(data_dir=tmp_path)
    halfway = settings.scratch_dir / "halfway"
    halfway.mkdir(parents=True)
    (halfway / "movie").write_bytes(b"half")
    with movie_runner.Scratch(settings.scratch_dir).directory() as used:
        MovieJobs(settings, store)
        assert (used.exists(), halfway.exists()) == (True, False)
    assert not used.exists()
