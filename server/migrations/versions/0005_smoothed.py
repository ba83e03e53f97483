"""Smoothed: which fold another one smooths."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"


def upgrade() -> None:
    """Migrate to this schema."""
    op.add_column("folds", sa.Column("smooths", sa.String(32)))
