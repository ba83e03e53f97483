"""Several machines: the faults with a real PostgreSQL, a real S3 server and two remote workers."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager

from bench.load.faults import FAULTS, faults
from bench.load.site import Setup
from bench.sections import Section
from tests.server.bucket import Bucket
from tests.server.postgres import Postgres


def several_machines(rounds: int, *, seed: int, only: tuple[str, ...] = ()) -> Section:
    """Inject a fault per round into a service on several machines, its database or its storage."""
    postgres, bucket = Postgres().start(), Bucket().start()

    @contextmanager
    def without_database() -> Generator[None]:
        postgres.kill()
        try:
            yield
        finally:
            postgres.start()

    setup = Setup(
        name="several machines",
        settings={"database_url": postgres.database(), "storage_url": bucket.bucket()},
        environment=bucket.environment,
        supervised=0,
        hosts=2,
        apart=True,
        outages={"database killed": without_database, "storage silent": bucket.silent},
    )
    try:
        return faults(rounds, seed=seed, setup=setup, only=only or (*FAULTS, *setup.outages))
    finally:
        bucket.close()
        postgres.close()
