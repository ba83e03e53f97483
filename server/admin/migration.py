"""Migration of the database: list of pending changes, and their execution."""

from __future__ import annotations

from foldback.server.settings import Settings
from foldback.server.store.schema import engine_of, migrate, missing_database, reading_connection
from foldback.server.store.schema_version import Schema


def schema_of(settings: Settings) -> Schema:
    """Return the version of the database's schema; nothing is changed.

    Raises:
        NewerSchemaError: If a newer foldback wrote them.
        SQLAlchemyError: If the database does not answer.
    """
    if missing_database(settings.store_url):
        return Schema.of(None)
    with reading_connection(settings.store_url) as connection:
        schema = Schema.of(connection)
    schema.check()
    return schema


def pending_changes(settings: Settings) -> list[str]:
    """Return one line for each change that `run_migration` would make; nothing is changed.

    Raises:
        NewerSchemaError: If a newer foldback wrote the database.
        SQLAlchemyError: If the database does not answer.
    """
    return [f"the database to version {version}" for version in schema_of(settings).missing]


def run_migration(settings: Settings) -> None:
    """Migrate the database to the newest version, as the service does when it starts.

    Raises:
        NewerSchemaError: If a newer foldback wrote the database.
        SQLAlchemyError: If the database does not answer.
        OSError: If the disk is read-only.
    """
    settings.make_directories()
    engine = engine_of(settings)
    try:
        migrate(engine)
    finally:
        engine.dispose()
