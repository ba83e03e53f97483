from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from server.settings import Settings
from server.store.folds import Store
from tests.server.bucket import Bucket
from tests.server.postgres import DATABASES, Postgres
from tests.server.service_process import SNAKE, Service
from tests.server.service_thread import ServiceThread, give_tables


@pytest.fixture
def here_with(tmp_path: Path) -> Iterator[Callable[..., ServiceThread]]:
    """Makes services of one's own in this process, with settings; they are stopped at the end."""
    made: list[ServiceThread] = []

    def make(**settings: object) -> ServiceThread:
        made.append(ServiceThread(tmp_path / f"here-{len(made)}", **settings))
        return made[-1]

    yield make
    for service in reversed(made):  # each puts back what it found
        if service.running:
            assert service.stop() == 0


@pytest.fixture
def without_ffmpeg(tmp_path: Path) -> dict[str, str]:
    """Return an environment whose processes have neither ffmpeg nor imageio-ffmpeg."""
    place = tmp_path / "without-ffmpeg"
    place.mkdir()
    (place / "sitecustomize.py").write_text("import sys; sys.modules['imageio_ffmpeg'] = None\n")
    pythonpath = f"{place}:{os.environ.get('PYTHONPATH', '')}"
    return {"PATH": str(place), "PYTHONPATH": pythonpath, "IMAGEIO_FFMPEG_EXE": ""}


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    """The folds of a service that has none yet."""
    settings = Settings(data_dir=tmp_path)
    give_tables(settings)
    with closing(Store(settings)) as store:
        yield store


@pytest.fixture(params=DATABASES)
def each_settings(request: pytest.FixtureRequest, tmp_path: Path) -> Settings:
    """Settings of a service with tables, for each kind of database."""
    sqlite = request.param == "sqlite"
    url = None if sqlite else request.getfixturevalue("postgres").migrated()
    settings = Settings(data_dir=tmp_path, database_url=url)
    give_tables(settings)
    return settings


@pytest.fixture
def each_store(each_settings: Settings) -> Iterator[Store]:
    """The folds of a service that has none yet, in each kind of database."""
    with closing(Store(each_settings)) as store:
        yield store


@pytest.fixture
def bucket_url(bucket: Bucket, monkeypatch: pytest.MonkeyPatch) -> str:
    """The URL of an empty bucket, which this process can reach."""
    for name, value in bucket.environment.items():
        monkeypatch.setenv(name, value)
    return bucket.bucket()


@pytest.fixture(scope="session")
def postgres() -> Iterator[Postgres]:
    """A PostgreSQL; `postgres.database()` makes an empty database in it."""
    made = Postgres()
    try:
        yield made.start()
    finally:
        made.remove()


@pytest.fixture(scope="session")
def bucket() -> Iterator[Bucket]:
    """A server of buckets; `bucket.bucket()` makes an empty one in it."""
    made = Bucket().start()
    try:
        yield made
    finally:
        made.stop()


@pytest.fixture(scope="session")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceThread]:
    """A service that takes folds in and has no worker: what is queued stays queued."""
    kept = tempfile.tempdir
    service = ServiceThread(
        tmp_path_factory.mktemp("desk") / "data",
        max_upload_bytes=200_000,
        max_modules=1000,
        largest_queue=1000,
        largest_queue_of_visitor=1000,
        largest_queue_seconds=1e9,
        largest_queue_seconds_of_visitor=1e9,
    ).start()
    tempfile.tempdir = kept  # what the tests of this process keep there is not the desk's
    yield service
    assert service.stop() == 0


@pytest.fixture(scope="session")
def finished(service: Service) -> dict[str, Any]:
    """A fold that is over: what the upload was answered, its events and its state."""
    accepted = service.fold(SNAKE, seed="3")
    events = list(service.events(accepted["id"]))
    return {
        "accepted": accepted,
        "id": accepted["id"],
        "events": events,
        "state": service.state(accepted["id"]),
    }
