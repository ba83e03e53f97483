"""Migration of the tables: what a start of this version would change, and the change itself."""

from __future__ import annotations

from server.settings import Settings
from server.store.schema_version import Schema
from server.store.tables import engine_of, migrate, missing_database, reading_connection


def schema_of(settings: Settings) -> Schema:
    """Return the version of the rows' tables; nothing is changed.

    Raises:
        NewerSchemaError: A newer foldback wrote them.
        SQLAlchemyError: The database does not answer.
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
        NewerSchemaError: A newer foldback wrote the tables.
        SQLAlchemyError: The database does not answer.
    """
    return [f"the tables of folds to version {version}" for version in schema_of(settings).missing]


def run_migration(settings: Settings) -> None:
    """Bring the tables to the newest version, as a start of the service does.

    Raises:
        NewerSchemaError: A newer foldback wrote the tables.
        SQLAlchemyError: The database does not answer.
        OSError: The disk is read-only.
    """
    settings.make_directories()
    engine = engine_of(settings)
    try:
        migrate(engine)
    finally:
        engine.dispose()
