"""Folds and their owners: the first schema."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None


def upgrade() -> None:
    """Migrate to this schema."""
    op.create_table(
        "folds",
        sa.Column("id", sa.String(32), primary_key=True),
        sa.Column("name", sa.String(200), nullable=False),
        sa.Column("status", sa.String(16), nullable=False),
        sa.Column("stage", sa.String(16)),
        sa.Column("created_at", sa.Double, nullable=False),
        sa.Column("started_at", sa.Double),
        sa.Column("ended_at", sa.Double),
        sa.Column("modules", sa.Integer, nullable=False),
        sa.Column("module", sa.String(32), nullable=False),
        sa.Column("shape", sa.String(64)),
        sa.Column("public", sa.Boolean, nullable=False),
        sa.Column("preset", sa.String(32), nullable=False),
        sa.Column("seed", sa.BigInteger, nullable=False),
        sa.Column("module_size", sa.Double),
        sa.Column("content_key", sa.String(64), unique=True),
        sa.Column("visitor", sa.String(64), nullable=False),
        sa.Column("cancel_requested", sa.Boolean, nullable=False),
        sa.Column("progress", sa.JSON, nullable=False),
        sa.Column("summary", sa.JSON, nullable=False),
        sa.Column("error", sa.JSON),
    )
    op.create_index("ix_folds_status", "folds", ["status"])
    op.create_index("ix_folds_created_at", "folds", ["created_at"])
    op.create_index("ix_folds_visitor", "folds", ["visitor"])
    op.create_table(
        "owners",
        sa.Column(
            "fold_id",
            sa.String(32),
            sa.ForeignKey("folds.id", ondelete="CASCADE"),
            primary_key=True,
        ),
        sa.Column("token_hash", sa.String(64), primary_key=True),
        sa.Column("created_at", sa.Double, nullable=False),
    )
    op.create_index("ix_owners_token_hash", "owners", ["token_hash"])
