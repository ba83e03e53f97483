"""Queue: the rows of folds and movies are the queue, without tables of a job system."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0013"
down_revision = "0012"


def upgrade() -> None:
    """Migrate to this schema."""
    op.add_column("folds", sa.Column("checkpoint", sa.JSON(), nullable=True))
    op.add_column("folds", sa.Column("losses", sa.Integer(), nullable=False, server_default="0"))
    op.add_column("movies", sa.Column("worker", sa.String(200), nullable=True))
    op.add_column("movies", sa.Column("losses", sa.Integer(), nullable=False, server_default="0"))
    # No worker of this version has them: they are computed again.
    op.execute("UPDATE folds SET worker = NULL")
    op.execute("UPDATE movies SET status = 'queued' WHERE status = 'running'")
    op.create_index("ix_folds_worker", "folds", ["worker"])
    op.create_index("ix_movies_worker", "movies", ["worker"])
