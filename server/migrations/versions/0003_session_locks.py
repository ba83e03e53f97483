"""Workers without heartbeats, and notices of jobs in PostgreSQL."""

from __future__ import annotations

from alembic import op

revision = "0003"
down_revision = "0002"

NOTIFY = """
CREATE OR REPLACE FUNCTION foldback_notify() RETURNS trigger LANGUAGE plpgsql AS
$$ BEGIN NOTIFY foldback_jobs; RETURN NULL; END $$
"""
TRIGGER = """
CREATE TRIGGER foldback_notify AFTER INSERT OR UPDATE OF status, worker ON {table} FOR EACH ROW
WHEN (NEW.status IN ('queued', 'running') AND NEW.worker IS NULL)
EXECUTE FUNCTION foldback_notify()
"""


def upgrade() -> None:
    """Drop the heartbeats; let PostgreSQL notify workers of folds and movies that wait."""
    with op.batch_alter_table("workers") as table:
        table.drop_column("beat")
    if op.get_context().dialect.name == "postgresql":
        op.execute(NOTIFY)
        for name in ("folds", "movies"):
            op.execute(TRIGGER.format(table=name))
