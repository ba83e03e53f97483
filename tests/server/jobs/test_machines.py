"""Several machines: what one takes in another computes and a third shows; none is needed."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import psutil
import psycopg
import pytest

from server.store.owner import new_token
from tests.server.bucket import Bucket
from tests.server.here import ServiceHere
from tests.server.hosts import Hosts
from tests.server.jobs.test_movies import LONG, SMALL
from tests.server.jobs.test_movies import wait as wait_movie
from tests.server.postgres import Postgres
from tests.server.service import PATIENCE_S, SNAKE, Service, over, owner
from tests.tools import OPENGL

pytestmark = pytest.mark.slow


@pytest.fixture
def hosts_with(
    tmp_path: Path, postgres: Postgres, bucket: Bucket
) -> Iterator[Callable[..., Hosts]]:
    with ExitStack() as stack:

        def make(**settings: object) -> Hosts:
            hosts = Hosts(tmp_path, postgres, bucket, **settings)
            stack.callback(hosts.close)
            return hosts

        yield make


def check_whole(service: Service, fold_id: str) -> dict[str, Any]:
    state = service.wait_over(fold_id)
    assert state["status"] == "verified", state
    body = service.http.get(f"/api/folds/{fold_id}/frames?stride=10").json()
    assert body["status"] == "complete", body["detail"]
    assert service.http.get(f"/api/folds/{fold_id}/plan.npz").status_code == 200
    return state


@pytest.mark.long
def test_machines_take_in_compute_and_show_one_fold(hosts_with: Callable[..., Hosts]) -> None:
    hosts = hosts_with()
    first, second = hosts.web(), hosts.web()
    # Large enough to be seen at work on a quick machine; with a seed it is the visitor's own.
    accepted = first.fold(shape="elephant", seed="1")
    fold_id = accepted["id"]
    assert second.state(fold_id)["progress"]["wait_s"] is None  # nobody computes yet
    with hosts.worker():
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
        held = hosts.kept()
        assert any(f"folds/{fold_id}/1/plan.npz" in name for name in held)
        assert not any(f"folds/{fold_id}/0/" in name for name in held)
        answer = second.http.delete(f"/api/folds/{fold_id}", headers=owner(accepted))
        assert answer.status_code == 204
        assert first.http.get(f"/api/folds/{fold_id}").status_code == 404
        assert first.http.get(f"/api/folds/{fold_id}/plan.npz").status_code == 404
        assert not any(fold_id in name for name in hosts.kept())


@pytest.mark.long
def test_folds_of_a_lost_host_are_taken_over(hosts_with: Callable[..., Hosts]) -> None:
    hosts = hosts_with(lease_s=2)
    web = hosts.web()
    with hosts.worker() as doomed:
        fold_id = web.fold(shape="wrench-160")["id"]
        web.wait_exploding(fold_id)
        with hosts.worker() as heir:
            web.wait_workers(2)
            doomed.kill()
            check_whole(web, fold_id)
            assert heir.poll() is None
            assert "taking over" in hosts.logs()
            epochs = {name.split("/")[-2] for name in hosts.kept() if name.endswith("plan.npz")}
            assert "2" in epochs
            web.wait_workers(1)


@pytest.mark.long
def test_draining_worker_finishes_its_fold(hosts_with: Callable[..., Hosts]) -> None:
    hosts = hosts_with(drain_s=PATIENCE_S)
    web = hosts.web()
    with hosts.worker() as worker:
        fold_id = web.fold(SNAKE)["id"]
        web.wait(fold_id, lambda state: state["status"] != "queued")
        waiting = web.fold(SNAKE, seed=1)["id"]
        worker.terminate()
        assert worker.wait(PATIENCE_S) == 0
    assert web.state(fold_id)["status"] == "verified"
    assert web.state(waiting)["status"] == "queued"


@pytest.mark.long
def test_fold_survives_a_database_outage(tmp_path: Path, bucket: Bucket) -> None:
    postgres = Postgres().start()
    hosts = Hosts(tmp_path, postgres, bucket)
    try:
        web = hosts.web()
        with hosts.worker():
            fold_id = web.fold(shape="wrench-160")["id"]
            web.wait_exploding(fold_id)
            postgres.kill()
            assert web.http.get(f"/api/folds/{fold_id}").status_code == 503
            assert web.http.get("/health").status_code == 200
            time.sleep(1.0)
            postgres.start()
            check_whole(web, fold_id)
            check_whole(web, web.fold(SNAKE)["id"])
    finally:
        hosts.close()
        postgres.remove()


@pytest.mark.long
def test_fold_survives_a_storage_outage(tmp_path: Path, postgres: Postgres) -> None:
    bucket = Bucket().start()
    hosts = Hosts(tmp_path, postgres, bucket)
    try:
        web = hosts.web()
        with hosts.worker():
            fold_id = web.fold(shape="wrench-160")["id"]
            web.wait_exploding(fold_id)
            with bucket.silent():
                answer = web.http.post("/api/folds", files={"file": ("snake.json", str(SNAKE))})
                assert answer.status_code == 503
                assert answer.json()["code"] == "storage"
                assert int(answer.headers["retry-after"]) > 0
            check_whole(web, fold_id)
            cancelled = web.fold(shape="wrench-160", seed=5)
            web.wait_exploding(cancelled["id"])
            with bucket.silent():  # nobody waits for it on behalf of what is not wanted
                path = f"/api/folds/{cancelled['id']}/cancel"
                assert web.http.post(path, headers=owner(cancelled)).status_code == 202
                assert web.wait_over(cancelled["id"])["status"] == "cancelled"
            check_whole(web, web.fold(SNAKE)["id"])
    finally:
        hosts.close()
        bucket.stop()


@pytest.mark.long
def test_cancellation_on_another_host_frees_the_core(hosts_with: Callable[..., Hosts]) -> None:
    hosts = hosts_with()
    first, second = hosts.web(), hosts.web()
    with hosts.worker() as worker:
        accepted = first.fold(shape="wrench-160", preset="paper")
        first.wait_exploding(accepted["id"])
        computing = [
            child
            for child in psutil.Process(worker.pid).children(recursive=True)
            if "foldback stages" in child.cmdline() and child.cpu_times().user > 0.5
        ]
        answer = second.http.post(f"/api/folds/{accepted['id']}/cancel", headers=owner(accepted))
        assert answer.status_code == 202
        second.wait_over(accepted["id"])
        assert not psutil.wait_procs(computing, timeout=PATIENCE_S)[1]
        check_whole(first, second.fold(SNAKE)["id"])


@pytest.mark.long
@pytest.mark.usefixtures("bucket_url")
def test_equal_requests_at_once_to_two_hosts_get_one_fold(
    hosts_with: Callable[..., Hosts],
) -> None:
    hosts = hosts_with()
    webs = [hosts.web(ServiceHere), hosts.web(ServiceHere)]  # they share nothing in this process
    token = new_token()
    with ThreadPoolExecutor(8) as threads:
        got = list(threads.map(lambda web: web.fold(SNAKE, token=token)["id"], webs * 4))
    assert len(set(got)) == 1


@pytest.mark.long
def test_two_web_processes_share_previews_files_and_movies(
    hosts_with: Callable[..., Hosts],
) -> None:
    OPENGL.get()
    hosts = hosts_with(lease_s=2.0)
    here, there = hosts.web(), hosts.web()

    def size(fold_id: str) -> int:
        with psycopg.connect(hosts.database_url) as connection:
            sizes = (
                "SELECT bytes + (SELECT coalesce(sum(bytes), 0) FROM movies WHERE fold_id = %s) "
                "FROM folds WHERE id = %s"
            )
            return connection.execute(sizes, [fold_id, fold_id]).fetchone()[0]  # type: ignore[index]

    with hosts.worker() as first:
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
        ready = wait_movie(there, movie, lambda m: m["status"] in ("ready", "failed"))
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
        begun = wait_movie(there, long, lambda m: m["frames_done"] > 1)["frames_done"]
        first.kill()
        first.wait()
    # Its worker is gone for good: another one makes the movie, from its beginning.
    with hosts.worker():
        wait_movie(there, long, lambda m: m["status"] == "running" and m["frames_done"] < begun)
        wait_movie(here, long, lambda m: m["frames_done"] > 0)
        assert (
            there.http.delete(f"/api/folds/{fold_id}", headers=owner(accepted)).status_code == 204
        )
        assert here.http.get(long["links"]["self"]).json()["code"] == "no-such-fold"
