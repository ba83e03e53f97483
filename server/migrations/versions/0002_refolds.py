"""Refolds: what the chain of a fold is folded as at the beginning."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"


def upgrade() -> None:
    """Migrate to this schema."""
    op.add_column("folds", sa.Column("refold", sa.String(200)))
