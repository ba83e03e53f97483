"""Several hosts on this machine, each with a directory of its own. They share only a real
PostgreSQL and a real S3 server."""

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import obstore
import obstore.store

from tests.server.bucket import Bucket
from tests.server.postgres import Postgres
from tests.server.service_process import Service


class Hosts:
    """Hosts that belong together: services without workers, and workers without a service."""

    def __init__(self, place: Path, postgres: Postgres, bucket: Bucket) -> None:
        self._place = place
        self._count = 0
        self._bucket = bucket
        self._services: list[Service] = []
        self._environment = bucket.environment
        self.storage_url = bucket.bucket()
        self.database_url = postgres.migrated()
        self._settings: dict[str, object] = {
            "database_url": self.database_url,
            "storage_url": self.storage_url,
            "workers": 0,
        }

    def web(self) -> Service:
        """Start a service on a host of its own."""
        service = self._host()
        self._services.append(service)
        return service.start()

    @contextmanager
    def worker(self) -> Iterator[subprocess.Popen[bytes]]:
        """Run a worker on a host of its own; it may have died by the end."""
        with self._host().worker() as worker:
            yield worker

    def stored_names(self) -> list[str]:
        """Return the names of all objects in the storage."""
        name = self.storage_url.removeprefix("s3://")
        store = obstore.store.S3Store(
            name,
            endpoint=self._bucket.endpoint,
            access_key_id="test",
            secret_access_key="test",
            client_options={"allow_http": True},
        )
        return [str(meta["path"]) for batch in obstore.list(store) for meta in batch]

    def close(self) -> None:
        """Stop the services."""
        for service in self._services:
            service.stop()

    def _host(self) -> Service:
        self._count += 1
        return Service(
            self._place / f"host-{self._count}", environment=self._environment, **self._settings
        )
