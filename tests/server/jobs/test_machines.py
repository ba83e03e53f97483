"""Several machines: what one takes in another computes and a third shows; none is needed."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from server.store.owner import new_token
from tests.server.bucket import Bucket
from tests.server.here import ServiceHere
from tests.server.hosts import Hosts
from tests.server.postgres import Postgres
from tests.server.service import PATIENCE_S, SNAKE, Service, over, owner

pytestmark = pytest.mark.slow


@pytest.fixture
def hosts_with(tmp_path: Path, postgres: Postgres, bucket: Bucket) -> Iterator[Any]:
    made: list[Hosts] = []

    def make(**settings: object) -> Hosts:
        made.append(Hosts(tmp_path, postgres, bucket, **settings))
        return made[-1]

    yield make
    for hosts in made:
        hosts.close()


def check_whole(service: Service, fold_id: str) -> dict[str, Any]:
    state = service.wait_over(fold_id)
    assert state["status"] == "verified", state
    body = service.http.get(f"/api/folds/{fold_id}/frames?stride=10").json()
    assert body["status"] == "complete", body["detail"]
    assert service.http.get(f"/api/folds/{fold_id}/plan.npz").status_code == 200
    return state


@pytest.mark.long
def test_what_one_takes_in_another_computes_and_a_third_shows(hosts_with: Any) -> None:
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
def test_the_folds_of_a_host_that_is_gone_are_taken_over(hosts_with: Any) -> None:
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
def test_a_worker_that_wakes_up_again_does_no_harm(hosts_with: Any) -> None:
    hosts = hosts_with(lease_s=2)
    web = hosts.web()
    with hosts.worker() as sleeper:
        fold_id = web.fold(shape="wrench-160")["id"]
        web.wait_exploding(fold_id)
        sleeper.send_signal(signal.SIGSTOP)
        try:
            with hosts.worker() as heir:
                deadline = time.monotonic() + PATIENCE_S
                while "taking over" not in hosts.logs():
                    assert time.monotonic() < deadline
                    time.sleep(0.1)
                sleeper.send_signal(signal.SIGCONT)
                ended = check_whole(web, fold_id)
                heir.kill()
        finally:
            sleeper.send_signal(signal.SIGCONT)
        # It is of use again.
        check_whole(web, web.fold(SNAKE)["id"])
        assert web.state(fold_id) == ended


@pytest.mark.long
def test_a_worker_that_ends_hands_back_at_once(hosts_with: Any) -> None:
    hosts = hosts_with(lease_s=3600)  # nobody would notice that it is gone
    web = hosts.web()
    with hosts.worker() as first:
        fold_id = web.fold(shape="wrench-160")["id"]
        web.wait_exploding(fold_id)
        with hosts.worker():
            web.wait_workers(2)
            first.terminate()
            assert first.wait(PATIENCE_S) == 0
            check_whole(web, fold_id)
            web.wait_workers(1)


@pytest.mark.long
def test_a_worker_may_finish_what_it_has_begun(hosts_with: Any) -> None:
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
def test_a_database_that_is_away_for_a_while_costs_nothing(tmp_path: Path, bucket: Bucket) -> None:
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
def test_a_storage_that_is_away_for_a_while_costs_nothing(
    tmp_path: Path, postgres: Postgres
) -> None:
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
def test_cancelling_frees_the_core(hosts_with: Any) -> None:
    hosts = hosts_with()
    first, second = hosts.web(), hosts.web()
    with hosts.worker() as worker:
        import psutil

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
        _, alive = psutil.wait_procs(computing, timeout=PATIENCE_S)
        assert not alive
        check_whole(first, second.fold(SNAKE)["id"])


@pytest.mark.long
def test_two_that_ask_for_the_same_get_the_same(
    hosts_with: Any, bucket: Bucket, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in bucket.environment.items():
        monkeypatch.setenv(name, value)
    hosts = hosts_with()
    webs = [hosts.web(ServiceHere), hosts.web(ServiceHere)]  # they share nothing in this process
    token = new_token()
    got: list[str] = []

    def ask(web: Service) -> None:
        got.append(web.fold(SNAKE, token=token)["id"])

    threads = [threading.Thread(target=ask, args=(web,)) for web in webs * 4]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(got) == len(threads)
    assert len(set(got)) == 1
