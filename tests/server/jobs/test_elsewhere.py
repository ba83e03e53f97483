"""Two web processes and workers on machines of their own: a database and a storage in common."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import psycopg
import pytest

from tests.server.bucket import Bucket
from tests.server.jobs.test_movies import wait
from tests.server.postgres import Postgres
from tests.server.service import SNAKE, Service, owner
from tests.tools import OPENGL

SMALL = {"width": 128, "height": 72, "fps": 10, "seconds": 0.4}
LONG = {"width": 128, "height": 72, "fps": 60, "seconds": 30}


@pytest.fixture
def machines(
    tmp_path: Path, postgres: Postgres, bucket: Bucket
) -> Iterator[tuple[Callable[[str], Service], str]]:
    """Makes machines by name, and the URL of their database."""
    OPENGL.get()
    settings = {
        "database_url": postgres.database(),
        "storage_url": bucket.bucket(),
        "workers": 0,
        "lease_s": 2.0,
    }
    made: list[Service] = []

    def make(name: str) -> Service:
        made.append(Service(tmp_path / name, environment=bucket.environment, **settings))
        return made[-1]

    yield make, settings["database_url"]
    for service in made:
        if service.process is not None and service.process.poll() is None:
            assert service.stop() == 0


@pytest.mark.long
def test_what_one_web_process_was_asked_for_all_have(
    machines: tuple[Callable[[str], Service], str],
) -> None:
    make, database = machines
    here, there = make("here").start(), make("there").start()

    def size(fold_id: str) -> int:
        with psycopg.connect(database) as connection:
            own = connection.execute("SELECT bytes FROM folds WHERE id = %s", [fold_id])
            movies = "SELECT coalesce(sum(bytes), 0) FROM movies WHERE fold_id = %s"
            of_movies = connection.execute(movies, [fold_id])
            return own.fetchone()[0] + of_movies.fetchone()[0]  # type: ignore[index]

    with make("first").worker() as first:
        # A preview is looked at, and folded, elsewhere.
        file = {"file": ("path.json", json.dumps(SNAKE))}
        preview = here.http.post("/api/shapes/preview", files=file).json()
        assert there.http.get(f"/previews/{preview['id']}").status_code == 200
        drawing = f"/previews/{preview['id']}/drawing.svg?key={preview['key']}"
        assert there.http.get(drawing).content == here.http.get(drawing).content
        scene = f"/previews/{preview['id']}/scene/{preview['key']}"
        assert there.http.get(scene).status_code == 200
        other = {"preview": preview["id"], "seed": "5"}
        more = there.http.post("/api/shapes/preview", data=other).json()
        assert here.http.get(f"/previews/{preview['id']}/scene/{more['key']}").status_code == 200
        assert there.http.get("/previews/nosuchpreview").status_code == 404
        accepted = there.fold(preview=preview["id"])
        fold_id = accepted["id"]
        assert here.wait_over(fold_id)["status"] == "verified"

        # What is made of a fold is made wherever it is asked for, also when a copy was dropped.
        for path in (
            f"/api/folds/{fold_id}/plan.json",
            f"/api/folds/{fold_id}/plan.npz",
            f"/api/folds/{fold_id}/exports/urdf",
            f"/folds/{fold_id}/picture.png",
            f"/folds/{fold_id}/standalone.html",
        ):
            assert here.http.get(path).status_code == there.http.get(path).status_code == 200, path
            for copy in (there.data_dir / "cache").iterdir():
                shutil.rmtree(copy)
            assert there.http.get(path).status_code == 200, path

        # A movie is asked for here, followed there, and taken from both.
        before = size(fold_id)
        movies = f"/api/folds/{fold_id}/movies"
        movie = here.http.post(movies, json=SMALL).json()
        assert there.http.post(movies, json=SMALL).json()["token"] is None
        ready = wait(there, movie, lambda m: m["status"] in ("ready", "failed"))
        assert (ready["status"], ready["frames_done"]) == ("ready", 4), ready
        file = there.http.get(movie["links"]["file"]).content
        assert file[4:8] == b"ftyp"
        assert here.http.get(movie["links"]["file"]).content == file
        assert size(fold_id) == before + len(file)
        headers = {"Authorization": f"Bearer {movie['token']}"}
        assert there.http.delete(movie["links"]["self"], headers=headers).status_code == 204
        assert here.http.get(movie["links"]["file"]).json()["code"] == "no-such-movie"
        assert size(fold_id) == before

        long = here.http.post(movies, json=LONG).json()
        begun = wait(there, long, lambda m: m["frames_done"] > 1)["frames_done"]
        first.kill()
        first.wait()
    # Its worker is gone for good: another one makes the movie, from its beginning.
    with make("second").worker():
        wait(there, long, lambda m: m["status"] == "running" and m["frames_done"] < begun)
        wait(here, long, lambda m: m["frames_done"] > 0)
        assert (
            there.http.delete(f"/api/folds/{fold_id}", headers=owner(accepted)).status_code == 204
        )
        assert here.http.get(long["links"]["self"]).json()["code"] == "no-such-fold"
