"""Pauses: folds that make room for others, and indexes of what is swept."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0012"
down_revision = "0011"


def upgrade() -> None:
    """Migrate to this schema."""
    op.add_column("folds", sa.Column("pauses", sa.Integer(), nullable=False, server_default="0"))
    op.add_column("folds", sa.Column("resumed_at", sa.Double(), nullable=True))
    op.execute("UPDATE folds SET seen_at = coalesce(ended_at, created_at) WHERE seen_at IS NULL")
    # They begin with what the narrower ones hold.
    op.drop_index("ix_folds_status", "folds")
    op.drop_index("ix_folds_visitor", "folds")
    op.create_index("ix_folds_status_seen_at", "folds", ["status", "seen_at"])
    op.create_index("ix_folds_visitor_status_seen_at", "folds", ["visitor", "status", "seen_at"])
    op.create_index("ix_folds_public_status", "folds", ["public", "status"])
