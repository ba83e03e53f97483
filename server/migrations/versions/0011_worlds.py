"""Worlds: where a fold was asked for, floating or on a table."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0011"
down_revision = "0010"


def upgrade() -> None:
    """Migrate to this schema."""
    op.add_column(
        "folds", sa.Column("world", sa.String(16), nullable=False, server_default="floating")
    )
