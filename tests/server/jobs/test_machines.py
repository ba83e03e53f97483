"""Several machines: one accepts a fold, another computes it, and a third shows it.

tests/bench/test_load.py checks that outages of each, and of what they share, are survived.
"""

import json
import shutil
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from typing import Any

import psutil
import psycopg
import pytest

from server.store.owner import new_token
from tests.server.bucket import Bucket
from tests.server.hosts import Hosts
from tests.server.jobs.test_movies import SMALL
from tests.server.jobs.test_movies import wait as wait_movie
from tests.server.postgres import Postgres
from tests.server.service_process import SNAKE, TIMEOUT_S, Service, bearer, over, owner
from tests.tools import OPENGL

pytestmark = pytest.mark.slow


@pytest.fixture
def hosts(tmp_path: Path, postgres: Postgres, bucket: Bucket) -> Iterator[Hosts]:
    with closing(Hosts(tmp_path, postgres, bucket)) as hosts:
        yield hosts


def check_whole(service: Service, fold_id: str) -> dict[str, Any]:
    state = service.wait_over(fold_id)
    assert state["status"] == "verified", state
    body = service.http.get(f"/api/folds/{fold_id}/frames?stride=10").json()
    assert body["status"] == "complete", body["detail"]
    assert service.http.get(f"/api/folds/{fold_id}/plan.npz").status_code == 200
    return state


@pytest.mark.long
def test_machines_take_in_compute_show_and_cancel_folds(hosts: Hosts) -> None:
    first, second = hosts.web(), hosts.web()
    token = new_token()
    with ThreadPoolExecutor(8) as threads:
        # Large enough to be observed on a fast machine; the token makes it the visitor's own.
        asked = [first, second] * 4
        got = list(
            threads.map(lambda web: web.fold(shape="elephant", seed="1", token=token), asked)
        )
    (fold_id,) = {accepted["id"] for accepted in got}
    assert second.state(fold_id)["progress"]["wait_s"] is None  # no worker runs yet
    with hosts.worker() as worker:
        seen: set[int] = set()

        def growing(state: dict[str, Any]) -> bool:
            body = second.http.get(f"/api/folds/{fold_id}/frames?stride=100000").json()
            if body.get("status") == "growing":
                seen.add(body["total"])
            return over(state)

        second.wait(fold_id, growing)
        assert len(seen) > 2, "the explosion was not seen while it was computed"
        check_whole(first, fold_id)
        check_whole(second, fold_id)
        plans = {s.http.get(f"/api/folds/{fold_id}/plan.npz").content for s in (first, second)}
        assert len(plans) == 1
        held = hosts.stored_names()
        assert any(f"folds/{fold_id}/1/plan.npz" in name for name in held)
        assert not any(f"folds/{fold_id}/0/" in name for name in held)
        answer = second.http.delete(f"/api/folds/{fold_id}", headers=bearer(token))
        assert answer.status_code == 204
        assert first.http.get(f"/api/folds/{fold_id}/plan.npz").status_code == 404
        assert not any(fold_id in name for name in hosts.stored_names())
        unwanted = first.fold(shape="wrench-160", preset="paper")
        first.wait_exploding(unwanted["id"])
        computing = [
            child
            for child in psutil.Process(worker.pid).children(recursive=True)
            if "foldback stages" in child.cmdline() and child.cpu_times().user > 0.5
        ]
        path = f"/api/folds/{unwanted['id']}/cancel"
        assert second.http.post(path, headers=owner(unwanted)).status_code == 202
        second.wait_over(unwanted["id"])
        assert not psutil.wait_procs(computing, timeout=TIMEOUT_S)[1]
        check_whole(first, second.fold(SNAKE)["id"])


@pytest.mark.long
def test_two_web_processes_share_previews_files_and_movies(hosts: Hosts) -> None:
    OPENGL.get()
    one, other = hosts.web(), hosts.web()

    def size(fold_id: str) -> int:
        with psycopg.connect(hosts.database_url) as connection:
            sizes = (
                "SELECT bytes + (SELECT coalesce(sum(bytes), 0) FROM movies WHERE fold_id = %s) "
                "FROM folds WHERE id = %s"
            )
            return connection.execute(sizes, [fold_id, fold_id]).fetchone()[0]  # type: ignore[index]

    with hosts.worker():
        # A preview is viewed and folded on the other machine.
        file = {"file": ("path.json", json.dumps(SNAKE))}
        preview = one.http.post("/api/shapes/preview", files=file).json()
        for part in (f"scene/{preview['key']}", f"drawing.svg?key={preview['key']}"):
            assert other.http.get(f"/previews/{preview['id']}/{part}").status_code == 200
        fold_id = other.fold(preview=preview["id"])["id"]
        assert one.wait_over(fold_id)["status"] == "verified"

        # Derived files are made wherever they are requested, also after a copy was dropped.
        for path in (
            f"/api/folds/{fold_id}/plan.npz",
            f"/api/folds/{fold_id}/exports/urdf",
            f"/folds/{fold_id}/picture.png",
        ):
            assert one.http.get(path).status_code == other.http.get(path).status_code == 200, path
            for copy in (other.data_dir / "cache").iterdir():
                shutil.rmtree(copy)
            assert other.http.get(path).status_code == 200, path

        # A movie is requested here, followed there, and removed from both.
        before = size(fold_id)
        movies = f"/api/folds/{fold_id}/movies"
        movie = one.http.post(movies, json=SMALL).json()
        assert other.http.post(movies, json=SMALL).json()["token"] is None
        ready = wait_movie(other, movie, lambda m: m["status"] in ("ready", "failed"))
        assert (ready["status"], ready["frames_done"]) == ("ready", 4), ready
        made = other.http.get(movie["links"]["file"]).content
        assert made[4:8] == b"ftyp"
        assert one.http.get(movie["links"]["file"]).content == made
        assert size(fold_id) == before + len(made)
        headers = bearer(movie["token"])
        assert other.http.delete(movie["links"]["self"], headers=headers).status_code == 204
        assert one.http.get(movie["links"]["file"]).json()["code"] == "no-such-movie"
        assert size(fold_id) == before
