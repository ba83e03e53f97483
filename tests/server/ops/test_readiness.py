"""Readiness: says no, and why, as soon as something that folds need is not there."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import httpx

from planner.pipeline.compiling_lock import FIRST_KERNELS_BYTES, FIRST_LOCK, CompilingLock
from server.ops.readiness import Readiness
from server.settings import Settings
from server.store.folds import Store
from server.store.leases import Leases
from server.store.stats import Stats
from tests.server.here import ServiceHere
from tests.server.postgres import Postgres
from tests.server.service import Service


def test_all_is_well(desk: Service) -> None:
    answer = desk.http.get("/ready")
    assert answer.status_code == 200
    assert answer.json() == {
        "ready": True,
        "database": "ok",
        "disk": "ok",
        "storage": "ok",
        "workers": 0,
        "reasons": [],
    }
    assert answer.headers["cache-control"] == "no-store"


def test_a_folder_that_is_gone_is_a_reason(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path, workers=0)
    store = Store(settings)
    stats = Stats(settings, Leases.of(settings, store))
    assert Readiness(settings, stats).state().ready
    settings.uploads_dir.rmdir()
    settings.folds_dir.rmdir()
    state = Readiness(settings, stats).state()
    assert not state.ready
    assert [reason.split(" ")[1] for reason in state.reasons] == ["disk", "storage"]
    assert not list(tmp_path.glob("**/*probe*"))
    stats.close()
    store.close()


def test_without_a_worker_it_is_not_ready(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path, workers=1)
    store = Store(settings)
    stats = Stats(settings, Leases.of(settings, store))
    assert Readiness(settings, stats).state().reasons == ("no worker is running",)
    stats.close()
    store.close()


def test_a_database_that_is_gone_is_a_reason(tmp_path: Path, postgres: Postgres) -> None:
    settings = Settings(data_dir=tmp_path, database_url=postgres.database(), workers=0)
    store = Store(settings)
    stats = Stats(settings, Leases.of(settings, store))
    readiness = Readiness(settings, stats)
    assert readiness.state().ready
    postgres.kill()
    try:
        state = readiness.state()
    finally:
        postgres.start()
    assert state.reasons == ("the database does not answer",)
    assert readiness.state().ready
    stats.close()
    store.close()


def test_it_says_so_while_it_ends(here_with: Callable[..., ServiceHere]) -> None:
    service = here_with(leave_s=1).start()
    with httpx.Client(base_url=service.http.base_url) as other:
        assert other.get("/ready").status_code == 200
        service.tell_to_end()
        while (answer := other.get("/ready")).status_code == 200:
            time.sleep(0.02)
        assert answer.status_code == 503
        assert answer.json()["reasons"] == ["the service is stopping"]
        assert other.get("/health").status_code == 200
    assert service.stop() == 0


def test_readiness_while_kernels_are_compiled_says_how_far_that_is(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path, workers=0)
    store = Store(settings)
    stats = Stats(settings, Leases.of(settings, store))
    lock = CompilingLock(settings.root / FIRST_LOCK)
    lock.acquire(lambda _: None)
    lock.add(FIRST_KERNELS_BYTES // 4)
    reasons = Readiness(settings, stats).state().reasons
    lock.release()
    assert reasons == ("kernels are being compiled (25%)",)
    assert Readiness(settings, stats).state().ready
    stats.close()
    store.close()
