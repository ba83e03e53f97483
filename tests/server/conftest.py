import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest

from foldback.server.cli import serve
from foldback.server.cli import worker as worker_command
from foldback.server.jobs import worker
from foldback.server.settings import Settings
from foldback.server.store.folds import Store
from tests.server.bucket import Bucket
from tests.server.postgres import DATABASES, Postgres
from tests.server.service_thread import ServiceThread, copy_schema


@pytest.fixture
def service_with(tmp_path: Path) -> Iterator[Callable[..., ServiceThread]]:
    """Function that creates services in this process; all are stopped at the end."""
    services: list[ServiceThread] = []

    def make(**settings: object) -> ServiceThread:
        services.append(ServiceThread(tmp_path / f"here-{len(services)}", **settings))
        return services[-1]

    yield make
    for service in reversed(services):  # each restores the state from before its start
        if service.running:
            assert service.stop() == 0


@pytest.fixture
def without_ffmpeg(tmp_path: Path) -> dict[str, str]:
    """Environment whose processes have neither ffmpeg nor imageio-ffmpeg."""
    place = tmp_path / "without-ffmpeg"
    place.mkdir()
    (place / "sitecustomize.py").write_text("import sys; sys.modules['imageio_ffmpeg'] = None\n")
    pythonpath = f"{place}:{os.environ.get('PYTHONPATH', '')}"
    return {"PATH": str(place), "PYTHONPATH": pythonpath, "IMAGEIO_FFMPEG_EXE": ""}


@pytest.fixture
def without_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    """Remove the settings of this machine from the environment."""
    for name in os.environ:
        if name.startswith("FOLDBACK_"):
            monkeypatch.delenv(name)


@pytest.fixture
def process_state(monkeypatch: pytest.MonkeyPatch) -> None:
    """Prevent commands of the service from changing the process of the tests."""
    for module in (serve, worker_command, worker):
        for name in ("keep_secrets", "set_up_logs"):
            monkeypatch.setattr(module, name, lambda *_: None, raising=False)


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    """Store of folds without any rows."""
    settings = Settings(data_dir=tmp_path)
    copy_schema(settings)
    with closing(Store(settings)) as store:
        yield store


@pytest.fixture(params=DATABASES)
def each_settings(request: pytest.FixtureRequest, tmp_path: Path) -> Settings:
    """Settings of a service with a schema, for each kind of database."""
    url = None if request.param == "sqlite" else request.getfixturevalue("postgres").migrated()
    settings = Settings(data_dir=tmp_path, database_url=url)
    copy_schema(settings)
    return settings


@pytest.fixture
def each_store(each_settings: Settings) -> Iterator[Store]:
    """Store of folds without any rows, in each kind of database."""
    with closing(Store(each_settings)) as store:
        yield store


@pytest.fixture
def bucket_url(bucket: Bucket, monkeypatch: pytest.MonkeyPatch) -> str:
    """URL of an empty bucket, which this process can reach."""
    for name, value in bucket.environment.items():
        monkeypatch.setenv(name, value)
    return bucket.bucket()


@pytest.fixture(scope="session")
def postgres() -> Iterator[Postgres]:
    """PostgreSQL server; `postgres.database()` creates an empty database in it."""
    with closing(Postgres()) as made_closing:
        yield made_closing.start()


@pytest.fixture(scope="session")
def bucket() -> Iterator[Bucket]:
    """Server of buckets; `bucket.bucket()` creates an empty one in it."""
    with closing(Bucket()) as made_closing:
        yield made_closing.start()


@pytest.fixture(scope="session")
def idle(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceThread]:
    """Service that accepts folds and has no worker, so that queued folds stay queued."""
    before = tempfile.tempdir
    service = ServiceThread(
        tmp_path_factory.mktemp("idle") / "data",
        max_upload_bytes=200_000,
        max_modules=1000,
        largest_queue=1000,
        largest_queue_of_visitor=1000,
        largest_queue_seconds=1e9,
        largest_queue_seconds_of_visitor=1e9,
    ).start()
    tempfile.tempdir = before  # other tests of this process may store theirs at the same time
    with service:
        yield service
