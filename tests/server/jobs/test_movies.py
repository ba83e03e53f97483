"""Movies over HTTP and on the command line; ../store/test_movie_rows.py tests their limits."""

import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pytest

from foldback.planner.pipeline.fold_layout import is_on_table
from foldback.server.pages.facts import fold_facts
from foldback.server.processes.children import Child
from foldback.server.store.fold_source import LocatedFold
from foldback.web.movies.encoding import find_ffmpeg
from foldback.words.fold import ShownFold
from tests.server.cli.test_command_line import foldback
from tests.server.service_process import (
    SNAKE,
    FinishedFold,
    Service,
    bearer,
    check_problem,
    wait_until,
)
from tests.server.service_thread import ServiceThread
from tests.tools import OPENGL

SMALL = {"width": 128, "height": 72, "fps": 10, "seconds": 0.4}
LONG = {"width": 128, "height": 72, "fps": 60, "seconds": 30}


@pytest.fixture(scope="module", autouse=True)
def backend() -> str:
    return OPENGL.get()


def ask(finished: FinishedFold, **options: Any) -> dict[str, Any]:
    answer = finished.http.post(f"{finished.api}/movies", json=options)
    assert answer.status_code == 202, answer.text
    return answer.json()


def wait(
    service: Service, movie: dict[str, Any], until: Callable[[dict[str, Any]], bool]
) -> dict[str, Any]:
    """Return the state of a movie once ``until`` is true."""
    path = movie["links"]["self"]
    wait_until(lambda: until(service.http.get(path).json()), service.log.read_text)
    return service.http.get(path).json()


def delete(service: Service, movie: dict[str, Any]) -> int:
    return service.http.delete(movie["links"]["self"], headers=bearer(movie["token"])).status_code


def over(movie: dict[str, Any]) -> bool:
    return movie["status"] in ("ready", "failed")


def children(service: Service) -> list[psutil.Process]:
    """Return the processes that make movies, including encoders."""
    makers = service.processes("foldback movies")
    return [*makers, *(child for maker in makers for child in maker.children())]


def test_movie_is_requested_made_downloaded_and_deleted(finished: FinishedFold) -> None:
    answer = finished.http.post(f"{finished.api}/movies", json={**SMALL, "tour": True})
    assert answer.status_code == 202
    movie = answer.json()
    assert answer.headers["Location"] == movie["links"]["self"]
    assert answer.headers["Retry-After"] == "1"
    assert (movie["frames_total"], movie["problem"]) == (4, None)
    assert finished.http.get(movie["links"]["file"]).status_code in (200, 409)
    ready = wait(finished.service, movie, over)
    assert (ready["status"], ready["frames_done"]) == ("ready", 4)
    file = finished.http.get(movie["links"]["file"])
    assert file.headers["Content-Type"] == "video/mp4"
    assert file.headers["Content-Disposition"].endswith('.mp4"')
    assert file.content[4:8] == b"ftyp"
    part = finished.http.get(movie["links"]["file"], headers={"Range": "bytes=4-7"})
    assert (part.status_code, part.content) == (206, b"ftyp")
    # Equivalent options give the same movie, which exists already.
    repeated_ask = ask(finished, **SMALL, format="mp4", theme=None, tour=True)
    assert (repeated_ask["id"], repeated_ask["status"], repeated_ask["token"]) == (
        movie["id"],
        "ready",
        None,
    )
    path = movie["links"]["self"]
    for headers in ({}, bearer("x" * 32)):
        check_problem(finished.http.delete(path, headers=headers), 403, "not-owner")
    assert movie["token"].encode() not in (finished.service.data_dir / "foldback.db").read_bytes()
    assert delete(finished.service, movie) == 204
    assert finished.http.get(movie["links"]["self"]).json()["code"] == "no-such-movie"
    assert finished.http.get(movie["links"]["file"]).status_code == 404


def test_bad_movies_are_refused(finished: FinishedFold) -> None:
    path = f"{finished.api}/movies"
    for options, code, error_place in (
        ({"width": 127}, "bad-movie", "width"),
        ({"width": 10**400}, "bad-movie", "width"),
        ({"seconds": 3600}, "bad-movie", "seconds"),
        ({"format": "avi"}, "bad-request", "body.format"),
        ({"widht": 128}, "bad-request", "body.widht"),
    ):
        answer = finished.http.post(path, json=options)
        assert answer.status_code == 422
        assert (answer.json()["code"], answer.json()["where"]) == (code, error_place)
    assert finished.http.get(f"{path}/0123456789ab").json()["code"] == "no-such-movie"
    assert finished.http.post("/api/folds/nosuchfold/movies", json={}).status_code == 404


@pytest.mark.long
def test_movie_deleted_while_it_is_made_stops(finished: FinishedFold) -> None:
    movie = ask(finished, **LONG)
    wait(finished.service, movie, lambda m: m["frames_done"] > 1)
    making = children(finished.service)
    assert len(making) == 2  # the process and its encoder
    assert delete(finished.service, movie) == 204
    _, alive = psutil.wait_procs(making, timeout=30)
    assert not alive
    # The next request gets its slot.
    assert wait(finished.service, ask(finished, **SMALL, theme="dark"), over)["status"] == "ready"
    scratch = finished.service.data_dir / "scratch"
    wait_until(lambda: not list(scratch.iterdir()))


def test_movie_that_cannot_be_made_here_is_refused_before_any_process_starts(
    finished: FinishedFold,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    without_ffmpeg: dict[str, str],
    idle: ServiceThread,
) -> None:
    movies = f"/api/folds/{idle.fold(SNAKE, seed='94')['id']}/movies"
    out = tmp_path / "out"
    out.mkdir()
    monkeypatch.setattr(Child, "call", lambda *_, **__: pytest.fail("a process has started"))
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    for environment, words in (
        ({"MUJOCO_GL": "off"}, "no-gl: Drawing is switched off by MUJOCO_GL; unset MUJOCO_GL."),
        (without_ffmpeg, "no-encoder: MP4 needs ffmpeg with x264: install it"),
    ):
        failed = foldback("movie", finished.directory, "--out", out / "fold.mp4", **environment)
        assert (failed.returncode, failed.stderr.count(words)) == (1, 1)
        assert not list(out.iterdir())
    for name, value in without_ffmpeg.items():
        monkeypatch.setenv(name, value)
    fold = ShownFold(id="one", name="One", status="verified", modules=16, preset="default", seed=0)
    found_fold = LocatedFold(fold, finished.directory)
    assert fold_facts(found_fold)["movies"] == ["gif"]
    refused = idle.http.post(movies, json={})
    check_problem(refused, 422, "no-encoder")
    assert refused.json()["where"] == "format"
    monkeypatch.setenv("MUJOCO_GL", "off")
    assert fold_facts(found_fold)["movies"] == []
    gif = idle.http.post(movies, json={"format": "gif"})
    check_problem(gif, 422, "no-gl")


@pytest.mark.long
def test_movie_command_films_with_any_ffmpeg_and_gif_without(
    finished: FinishedFold, tmp_path: Path, without_ffmpeg: dict[str, str]
) -> None:
    directory, out = finished.directory, tmp_path / "out"
    out.mkdir()
    size = ["--width", "128", "--height", "72", "--fps", "10", "--seconds", "0.3"]
    foldback("movie", directory, "--out", out / "fold.gif", *size, **without_ffmpeg)
    assert (out / "fold.gif").read_bytes().startswith(b"GIF89a")
    # The confined process may run an encoder that is neither in /usr nor in Python's directory.
    program = tmp_path / "own" / "bin" / "ffmpeg"
    program.parent.mkdir(parents=True)
    shutil.copy(find_ffmpeg(), program)
    environment = {**without_ffmpeg, "PATH": str(program.parent)}
    backwards = ["--from", "5", "--to", "0", "--json"]
    done = foldback("movie", directory, "--out", out / "fold.mp4", *size, *backwards, **environment)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["pictures"] == 3


def test_only_folds_on_a_table_are_filmed_on_one(tmp_path: Path) -> None:
    assert not is_on_table(tmp_path)
    for text in ('{"world": "floating"}', "{}", "[]", "what", '{"world": "table"}'):
        (tmp_path / "request.json").write_text(text)
        assert is_on_table(tmp_path) == ("table" in text), text
