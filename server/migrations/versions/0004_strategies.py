"""Strategies: how a fold's chain is wished to be let go."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"


def upgrade() -> None:
    """Migrate to this schema."""
    op.add_column(
        "folds", sa.Column("strategy", sa.String(16), nullable=False, server_default="auto")
    )
