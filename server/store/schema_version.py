"""Schema version: version of a database's schema, compared with those known to this version."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Final

import sqlalchemy as sa
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory

MIGRATIONS: Final = Path(str(files("foldback.server") / "migrations"))
"""Directory of the migrations, one file for each version of the schema."""


class NewerSchemaError(Exception):
    """A newer foldback has written the database."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Schema:
    """Versions of the database's schema.

    Attributes:
        version: Version of the database's schema; None if the database is empty.
        known_versions: Versions that this foldback knows, oldest first.
    """

    version: str | None
    known_versions: tuple[str, ...]

    @classmethod
    def of(cls, connection: sa.Connection | None) -> Schema:
        """Return the schema of a database; nothing is changed.

        Args:
            connection: The database; None if there is none yet.

        Raises:
            SQLAlchemyError: If the database does not answer.
        """
        revision = None
        if connection is not None:
            revision = MigrationContext.configure(connection).get_current_revision()
        return cls(version=revision, known_versions=known_versions())

    @property
    def head(self) -> str:
        """Newest known version."""
        return self.known_versions[-1]

    @property
    def newer(self) -> bool:
        """True if a newer foldback wrote the database."""
        return self.version is not None and self.version not in self.known_versions

    @property
    def missing(self) -> tuple[str, ...]:
        """Versions to which the database has not been migrated yet, oldest first."""
        if self.version is None:
            return self.known_versions
        return (
            () if self.newer else self.known_versions[self.known_versions.index(self.version) + 1 :]
        )

    def check(self) -> None:
        """Refuse a database that a newer foldback wrote.

        Raises:
            NewerSchemaError: If a newer foldback wrote it.
        """
        if self.newer:
            raise NewerSchemaError(
                f"got a database of version {self.version}, expected {self.head} at "
                f"most. A newer foldback than this one ({version('foldback')}) wrote the database. "
                "Install the newer version again, or restore an older backup."
            )


@cache
def known_versions() -> tuple[str, ...]:
    """Return the versions of the schema that this foldback knows, oldest first."""
    # Reading them runs every file of migrations.
    scripts = ScriptDirectory.from_config(config())
    return tuple(reversed([script.revision for script in scripts.walk_revisions()]))


def config() -> Config:
    """Return alembic's configuration, with the directory of the migrations."""
    alembic_config = Config()
    alembic_config.set_main_option("script_location", str(MIGRATIONS))
    alembic_config.set_main_option("path_separator", "os")
    return alembic_config
