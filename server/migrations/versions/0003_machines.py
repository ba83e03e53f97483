"""Many machines: turns, epochs, workers, movies as rows, secrets, and what is kept how long."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"


def upgrade() -> None:
    """Migrate to this schema."""
    for column in (
        sa.Column("turn", sa.BigInteger, nullable=False, server_default="0"),
        sa.Column("cost_s", sa.Double, nullable=False, server_default="0"),
        sa.Column("worker", sa.String(200)),
        sa.Column("epoch", sa.Integer, nullable=False, server_default="0"),
        sa.Column("kept", sa.Integer, nullable=False, server_default="0"),
        sa.Column("bytes", sa.BigInteger, nullable=False, server_default="0"),
        sa.Column("seen_at", sa.Double),
        sa.Column("pinned", sa.Boolean, nullable=False, server_default=sa.false()),
    ):
        op.add_column("folds", column)
    op.create_table(
        "workers",
        sa.Column("name", sa.String(200), primary_key=True),
        sa.Column("host", sa.String(200), nullable=False),
        sa.Column("pid", sa.Integer, nullable=False),
        sa.Column("beat", sa.BigInteger, nullable=False),
        sa.Column("folds_at_once", sa.Integer, nullable=False),
        sa.Column("started_at", sa.Double, nullable=False),
        sa.Column("version", sa.String(32), nullable=False),
    )
    op.create_table(
        "movies",
        sa.Column(
            "fold_id",
            sa.String(32),
            sa.ForeignKey("folds.id", ondelete="CASCADE"),
            primary_key=True,
        ),
        sa.Column("id", sa.String(32), primary_key=True),
        sa.Column("job", sa.String(128), nullable=False, unique=True),
        sa.Column("wishes", sa.JSON, nullable=False),
        sa.Column("visitor", sa.String(64), nullable=False),
        sa.Column("token_hash", sa.String(64), nullable=False),
        sa.Column("status", sa.String(16), nullable=False),
        sa.Column("frames_done", sa.Integer, nullable=False),
        sa.Column("problem", sa.JSON),
        sa.Column("created_at", sa.Double, nullable=False),
        sa.Column("bytes", sa.BigInteger, nullable=False, server_default="0"),
    )
    op.create_index("ix_movies_status", "movies", ["status"])
    op.create_table(
        "secrets",
        sa.Column("name", sa.String(32), primary_key=True),
        sa.Column("value", sa.LargeBinary, nullable=False),
    )
    counters = op.create_table(
        "counters",
        sa.Column("name", sa.String(32), primary_key=True),
        sa.Column("value", sa.BigInteger, nullable=False),
    )
    op.bulk_insert(counters, [{"name": "turn", "value": 0}])
