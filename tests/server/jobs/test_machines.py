"""Several machines: one accepts a fold, another computes it, and a third shows it.

tests/bench/test_load.py checks outages of each machine and of shared services.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from itertools import count
from pathlib import Path
from typing import Any

import psutil
import pytest
import sqlalchemy as sa

from foldback.server.settings import Settings
from foldback.server.store.object_store import open_storage
from foldback.server.store.owner import new_token
from foldback.server.store.schema import FoldRow, WorkerRow, engine_for
from tests.server.jobs.test_durability import check_finished
from tests.server.postgres import Postgres
from tests.server.service_process import SNAKE, TIMEOUT_S, Service, bearer, over, owner, wait_until

pytestmark = pytest.mark.slow


@pytest.fixture
def machine(tmp_path: Path, postgres: Postgres, bucket_url: str) -> Callable[..., Service]:
    """Function that adds a machine, which shares only a database and a storage with the others."""
    shared = {"database_url": postgres.migrated(), "storage_url": bucket_url, "workers": 0}
    numbers = count()
    return lambda **settings: Service(
        tmp_path / f"machine-{next(numbers)}", **{**shared, **settings}
    )


@pytest.mark.long
def test_machines_take_in_compute_show_and_cancel_folds(
    machine: Callable[..., Service], bucket_url: str, tmp_path: Path
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


@pytest.mark.long
def test_suspended_worker_loses_its_fold_and_takes_its_name_again(
    machine: Callable[..., Service],
) -> None:
    hosts = [machine(lease_s=1.0) for _ in range(2)]
    with ExitStack() as stack:
        web = stack.enter_context(machine().start())
        engine = engine_for(
            Settings(database_url=web.environment["FOLDBACK_DATABASE_URL"]).store_url
        )
        stack.callback(engine.dispose)
        workers = {
            worker.pid: worker for worker in (stack.enter_context(h.worker()) for h in hosts)
        }
        web.wait_workers(2)
        fold = web.fold(shape="wrench-160", preset="paper")
        web.wait_exploding(fold["id"])

        def holder() -> tuple[str, int]:
            """Return the name of the worker that has the fold, and its process."""
            with engine.connect() as connection:
                query = sa.select(WorkerRow.name, WorkerRow.pid).where(
                    FoldRow.id == fold["id"], FoldRow.worker.startswith(WorkerRow.name + ":")
                )
                row = connection.execute(query).first()
            return ("", 0) if row is None else (row.name, row.pid)

        first, pid = holder()
        suspended = psutil.Process(pid)
        suspended.suspend()
        wait_until(lambda: holder()[0] not in (first, ""))
        suspended.resume()
        log = next(host.log for host in hosts if f"worker {first} is ready" in host.log.read_text())
        wait_until(lambda: "was taken over by" in log.read_text(), log.read_text)
        workers[holder()[1]].kill()
        wait_until(lambda: holder()[0] == first, log.read_text)
        path = f"/api/folds/{fold['id']}/cancel"
        assert web.http.post(path, headers=owner(fold)).status_code == 202
        web.wait_over(fold["id"])
