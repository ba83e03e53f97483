"""Preferences: which of several verified plans a fold was asked for."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0009"
down_revision = "0008"


def upgrade() -> None:
    """Migrate to this schema."""
    op.add_column(
        "folds", sa.Column("prefer", sa.String(16), nullable=False, server_default="computing")
    )
