"""Several machines: one accepts a fold, another computes it, and a third shows it.

tests/bench/test_load.py checks that outages of each, and of what they share, are survived.
"""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from typing import Any

import psutil
import pytest

from server.store.owner import new_token
from tests.server.bucket import Bucket
from tests.server.hosts import Hosts
from tests.server.postgres import Postgres
from tests.server.service_process import SNAKE, TIMEOUT_S, Service, bearer, over, owner

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
