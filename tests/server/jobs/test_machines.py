"""Several machines: one accepts a fold, another computes it, and a third shows it.

tests/bench/test_load.py checks outages of each machine and of shared services.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import count
from pathlib import Path
from typing import Any

import psutil
import pytest

from foldback.server.settings import Settings
from foldback.server.store.object_store import open_storage
from foldback.server.store.owner import new_token
from tests.server.jobs.test_durability import check_finished
from tests.server.postgres import Postgres
from tests.server.service_process import SNAKE, TIMEOUT_S, Service, bearer, over, owner

pytestmark = pytest.mark.slow


@pytest.fixture
def machine(tmp_path: Path, postgres: Postgres, bucket_url: str) -> Callable[[], Service]:
    """Function that adds a machine, which shares only a database and a storage with the others."""
    shared = {"database_url": postgres.migrated(), "storage_url": bucket_url, "workers": 0}
    numbers = count()
    return lambda: Service(tmp_path / f"machine-{next(numbers)}", **shared)


@pytest.mark.long
def test_machines_take_in_compute_show_and_cancel_folds(
    machine: Callable[[], Service], bucket_url: str, tmp_path: Path
) -> None:
    first, second = machine().start(), machine().start()
    storage = open_storage(Settings(data_dir=tmp_path, storage_url=bucket_url))
    assert storage is not None
    token = new_token()
    with ThreadPoolExecutor(8) as threads:
        # The fold takes long enough to be observed on a fast machine; the token sets its owner.
        request = [first, second] * 4
        sent_rows = list(
            threads.map(lambda web: web.fold(shape="elephant", seed="1", token=token), request)
        )
    (fold_id,) = {accepted["id"] for accepted in sent_rows}
    assert second.state(fold_id)["progress"]["wait_s"] is None  # no worker runs yet
    with machine().worker() as worker:
        seen_ids: set[int] = set()

        def growing(state: dict[str, Any]) -> bool:
            body = second.http.get(f"/api/folds/{fold_id}/frames?stride=100000").json()
            if body.get("status") == "growing":
                seen_ids.add(body["total"])
            return over(state)

        second.wait(fold_id, growing)
        assert len(seen_ids) > 2, "the explosion was not seen while it was computed"
        plans = [check_finished(web, fold_id) for web in (first, second)]
        assert plans[0] == plans[1]
        assert storage.below(f"folds/{fold_id}") == ["1"]  # only the files of the first epoch
        answer = second.http.delete(f"/api/folds/{fold_id}", headers=bearer(token))
        assert answer.status_code == 204
        assert first.http.get(f"/api/folds/{fold_id}/plan.npz").status_code == 404
        assert fold_id not in storage.below("folds")
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
        check_finished(first, second.fold(SNAKE)["id"])
    assert [first.stop(), second.stop()] == [0, 0]
