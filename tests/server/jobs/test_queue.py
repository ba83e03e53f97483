"""Queue: assignment of jobs, contents of checkpoints, and work repeated after a lost worker."""

import random
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import psycopg
import pytest
import sqlalchemy as sa

from foldback.planner.progress import STAGES
from foldback.server.jobs.dispatcher import Dispatcher
from foldback.server.jobs.queue import FoldClaim, Lane, MovieClaim, Queue
from foldback.server.jobs.worker import recover
from foldback.server.limits.fair_queue import QUICK_FOLD_S
from foldback.server.settings import Settings
from foldback.server.store.folds import Store
from foldback.server.store.leases import Leases
from foldback.server.store.schema import JOBS_CHANNEL, FoldRow
from tests.server.postgres import Postgres
from tests.server.rows import SOMEBODY, a_fold, a_movie, live_worker, scans, statements
from tests.server.service_process import TIMEOUT_S, wait_until


@pytest.fixture
def store(each_store: Store) -> Store:
    return each_store


def add(store: Store, fold_id: str, **values: Any) -> None:
    with store.changing() as session:
        session.add(a_fold(fold_id, **{"status": "queued", "owner": SOMEBODY.digest, **values}))


def claim_fold(queue: Queue, lane: Lane = Lane.QUICK, worker: str = "one") -> FoldClaim:
    claim = queue.claim(lane, worker)
    assert isinstance(claim, FoldClaim)
    return claim


def test_folds_are_claimed_in_their_turn_and_lane(store: Store) -> None:
    queue = Queue(store)
    for fold_id, turn in {"last": 70, "first": 0, "middle": 3}.items():
        add(store, fold_id, turn=turn, cost_s=QUICK_FOLD_S)
    add(store, "long", cost_s=QUICK_FOLD_S + 1.0)
    assert [claim_fold(queue).fold_id for _ in range(3)] == ["first", "middle", "last"]
    assert claim_fold(queue, Lane.LONG).fold_id == "long"
    assert [queue.claim(lane, "one") for lane in Lane] == [None] * 3
    with store.reading() as session:
        rows = session.query(FoldRow).all()
    assert {(row.status, row.stage, row.epoch) for row in rows} == {("running", "read", 1)}


def test_each_job_is_claimed_once(store: Store) -> None:
    names = [f"f{k}" for k in range(9)]
    for name in names:
        add(store, name)
        with store.changing() as session:
            session.add(a_movie(name, "m", status="queued"))
    ready = threading.Barrier(4)

    def claim_all(worker: int) -> list[str]:
        queue = Queue(store)
        ready.wait()
        jobs = []
        for lane in (Lane.QUICK, Lane.MOVIES):
            while (claim := queue.claim(lane, f"worker{worker}")) is not None:
                jobs.append(claim.job if isinstance(claim, MovieClaim) else claim.fold_id)
        return jobs

    with ThreadPoolExecutor(4) as threads:
        taken_jobs = sorted(job for jobs in threads.map(claim_all, range(4)) for job in jobs)
    assert taken_jobs == sorted([*names, *(f"{name}-m" for name in names)])


def test_fold_continues_after_its_last_finished_stage(store: Store) -> None:
    queue = Queue(store)
    add(store, "a")
    first = claim_fold(queue)
    assert (first.stage, first.files) == ("read", 0)
    assert queue.keep(first, stage="explode", files=1)
    queue.hand_back(first)
    second = claim_fold(queue, worker="two")
    assert (second.stage, second.files, second.losses) == ("explode", 1, 0)
    assert store.fold("a").stage == "explode"
    # The first execution has lost its lease: all its later writes are ignored.
    assert not queue.keep(first, stage="certify", files=1)
    queue.hand_back(first)
    assert store.finish("a", "failed", summary={}, execution=first.execution)
    row = store.fold("a")
    assert (row.status, row.worker, row.epoch) == ("running", second.execution, 2)
    assert store.finish("a", "verified", summary={}, execution=second.execution)
    queue.release(second)
    assert (store.fold("a").status, store.fold("a").worker) == ("verified", None)


def test_jobs_of_a_lost_worker_are_queued_again_and_losses_are_counted(store: Store) -> None:
    queue = Queue(store)
    for name in ("running", "cancelled", "ended", "another"):
        add(store, name)
        claim_fold(queue, worker="other" if name == "another" else "one")
    with store.changing() as session:
        session.add(a_movie("running", "m", status="queued"))
    movie = queue.claim(Lane.MOVIES, "one")
    assert isinstance(movie, MovieClaim)
    with store.changing() as session:
        session.query(FoldRow).filter_by(id="cancelled").update({"cancel_requested": True})
    store.finish("ended", "verified", summary={}, kept_epoch=1)
    assert queue.holders() == {"one", "other"}
    assert queue.hand_back_all("one", lost=True) == [("ended", 1)]
    assert queue.holders() == {"other"}
    folds = {name: store.fold(name) for name in ("running", "cancelled", "ended", "another")}
    assert {name: row.status for name, row in folds.items()} == {
        **{"running": "running", "cancelled": "cancelled"},
        **{"ended": "verified", "another": "running"},
    }
    assert (folds["running"].losses, folds["another"].losses) == (1, 0)
    second_fold_claim = claim_fold(queue, worker="one")
    assert (second_fold_claim.fold_id, second_fold_claim.losses) == ("running", 1)
    assert queue.keep(second_fold_claim, stage="explode", files=2)
    queue.hand_back_all("one", lost=False)
    assert claim_fold(queue).losses == 0, "a finished stage is progress"
    repeated = queue.claim(Lane.MOVIES, "two")
    assert isinstance(repeated, MovieClaim) and (repeated.job, repeated.losses) == (movie.job, 1)


def test_cancelled_fold_without_a_worker_ends_at_once(store: Store) -> None:
    queue = Queue(store)
    store.add(a_fold("a", status="queued"), SOMEBODY)
    queue.hand_back(claim_fold(queue))
    assert store.fold("a").status == "running", "its visitors see no difference"
    assert store.cancel("a", SOMEBODY)
    assert store.fold("a").status == "cancelled"
    assert queue.claim(Lane.QUICK, "two") is None


def test_name_of_a_worker_is_not_a_pattern(store: Store) -> None:
    queue = Queue(store)
    add(store, "a")
    claim_fold(queue, worker="host/1")
    for host_name in ("host/%", "host/_", "host/"):
        queue.hand_back_all(host_name, lost=True)
    assert store.fold("a").status == "running"


def test_executions_killed_at_random_repeat_no_finished_stage(store: Store) -> None:
    """Model of a fold whose worker dies at 12 random points: every stage finishes once."""
    queue, dice = Queue(store), random.Random(1)
    deaths, finished = 0, []
    while deaths < 12:
        name = f"f{len(finished)}"
        add(store, name, cost_s=1.0)
        for stage, following in zip(STAGES, [*STAGES[1:], None], strict=True):
            claim = claim_fold(queue, worker=f"w{deaths}")
            while dice.random() < 0.7:
                queue.hand_back_all(f"w{deaths}", lost=True)
                deaths += 1
                claim = claim_fold(queue, worker=f"w{deaths}")
                assert claim.stage == stage, "a finished stage was repeated"
            if following is None:
                assert store.finish(name, "verified", summary={}, execution=claim.execution)
                queue.release(claim)
            else:
                assert queue.keep(claim, stage=following, files=store.fold(name).epoch)
                queue.hand_back(claim)
        finished.append(name)
    assert all(store.fold(name).status == "verified" for name in finished)


def test_check_for_jobs_reads_an_index_only(store: Store) -> None:
    queue = Queue(store)
    with statements() as queries:
        assert not queue.has_work()
        assert [queue.claim(lane, "one") for lane in Lane] == [None] * 3
        assert queue.holders() == set()
    assert set(scans(store, queries)) <= {"SCAN CONSTANT ROW"}


@pytest.mark.processes
def test_workers_are_notified_of_jobs_that_wait_only(tmp_path: Path, postgres: Postgres) -> None:
    url = postgres.migrated()
    with closing(Store(Settings(data_dir=tmp_path, database_url=url))) as store:
        queue = Queue(store)
        with psycopg.connect(url, autocommit=True) as listener:
            listener.execute(f"LISTEN {JOBS_CHANNEL}".encode())

            def notices() -> int:
                with store.changing() as session:
                    session.execute(sa.select(sa.func.pg_notify(JOBS_CHANNEL, "end")))
                arrived = iter(listener.notifies(timeout=TIMEOUT_S))
                return sum(1 for _ in iter(lambda: next(arrived).payload, "end"))

            add(store, "a")
            assert notices() == 1
            claim = claim_fold(queue)
            assert queue.keep(claim, stage="explode", files=1)
            store.report("a", 1, {"frames": 1})
            assert notices() == 0
            queue.hand_back(claim)
            assert notices() == 1
            queue.release(claim_fold(queue))
            with store.changing() as session:
                session.add(a_movie("a", "m", status="queued"))
            assert notices() == 2


class Lease:
    """Lease that tests give and take."""

    queue_poll_s = 0.01
    settled = False

    def __init__(self) -> None:
        self.asked = 0
        self.held_now = False

    @property
    def held(self) -> bool:
        self.asked += 1
        return self.held_now


def test_worker_takes_jobs_only_while_it_holds_its_name(store: Store) -> None:
    queue, lease = Queue(store), Lease()
    add(store, "a")
    dispatcher = Dispatcher(queue, Mock(), Mock(), worker="one", folds_at_once=1)
    dispatcher.start(lease)
    wait_until(lambda: lease.asked > 3)
    assert queue.holders() == set()
    lease.held_now = True
    wait_until(lambda: queue.holders() == {"one"})
    dispatcher.close()
    wait_until(lambda: not [t for t in threading.enumerate() if t.name == "dispatcher"])


def test_jobs_of_dead_workers_are_taken_over_once_all_had_time_to_return(
    each_settings: Settings, store: Store
) -> None:
    queue, leases, lease = Queue(store), Leases(each_settings, store), Lease()
    for name in ("dead", "live"):
        add(store, name)
        claim_fold(queue, worker=name)
    with live_worker(leases, "live"):
        recover(store, queue, leases, lease)
        assert queue.holders() == {"dead", "live"}
        lease.settled = True
        recover(store, queue, leases, lease)
        assert queue.holders() == {"live"}
