"""Readiness: refused, with the reason, as soon as a requirement of folds is missing."""

import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import httpx

from foldback.server.ops.readiness import Readiness
from foldback.server.settings import Settings
from foldback.server.store.folds import Store
from foldback.server.store.leases import Leases
from tests.server.postgres import Postgres
from tests.server.service_process import Service
from tests.server.service_thread import ServiceWith, copy_schema


@contextmanager
def readiness(settings: Settings) -> Iterator[Readiness]:
    copy_schema(settings)
    with closing(Store(settings)) as store:
        yield Readiness(settings, Leases(settings, store))


def test_ready_service_reports_its_parts(idle: Service) -> None:
    answer = idle.http.get("/ready")
    assert answer.status_code == 200
    parts = dict.fromkeys(("database", "disk", "storage"), "ok")
    assert answer.json() == {"ready": True, **parts, "workers": 0, "reasons": []}
    assert answer.headers["cache-control"] == "no-store, no-transform"


def test_missing_folders_and_workers_are_reasons(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path, workers=0)
    with readiness(settings) as ready:
        assert ready.state().ready
    with readiness(Settings(data_dir=tmp_path, workers=1)) as ready:
        assert ready.state().reasons == ("no worker is running",)
    with readiness(settings) as ready:
        settings.uploads_dir.rmdir()
        settings.folds_dir.rmdir()
        state = ready.state()
    assert not state.ready
    assert [reason.split(" ")[1] for reason in state.reasons] == ["disk", "storage"]
    assert not list(tmp_path.glob("**/*probe*"))


def test_missing_database_is_a_reason(tmp_path: Path, postgres: Postgres) -> None:
    settings = Settings(data_dir=tmp_path, database_url=postgres.migrated(), workers=0)
    with readiness(settings) as ready:
        assert ready.state().ready
        postgres.kill()
        try:
            state = ready.state()
        finally:
            postgres.start()
        assert state.reasons == ("the database does not answer",)
        assert ready.state().ready


def test_stopping_service_is_not_ready(service_with: ServiceWith) -> None:
    service = service_with(leave_s=1).start()
    with httpx.Client(base_url=service.http.base_url) as other_client:
        assert other_client.get("/ready").status_code == 200
        service.request_stop()
        while (answer := other_client.get("/ready")).status_code == 200:
            time.sleep(0.02)
        assert answer.status_code == 503
        assert answer.json()["reasons"] == ["the service is stopping"]
        assert other_client.get("/health").status_code == 200
    assert service.stop() == 0
