"""The PostgreSQL of the tests itself: what is written stays over a restart, databases are apart."""

from __future__ import annotations

import psycopg
import pytest

from tests.server.postgres import Postgres


def test_each_test_has_a_database_of_its_own(postgres: Postgres) -> None:
    here, there = postgres.database(), postgres.database()
    with psycopg.connect(here) as connection:
        connection.execute("CREATE TABLE t AS SELECT 1")
    with psycopg.connect(there) as connection, pytest.raises(psycopg.errors.UndefinedTable):
        connection.execute("SELECT * FROM t")


def test_it_can_be_killed_and_comes_back_with_what_it_knew(postgres: Postgres) -> None:
    url = postgres.database()
    with psycopg.connect(url) as connection:
        connection.execute("CREATE TABLE t AS SELECT 7 AS n")
    postgres.kill()
    try:
        with pytest.raises(psycopg.OperationalError):
            psycopg.connect(url)
    finally:
        postgres.start()
    with psycopg.connect(url) as connection:
        assert connection.execute("SELECT n FROM t").fetchone() == (7,)
