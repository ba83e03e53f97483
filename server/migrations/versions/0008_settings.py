"""Settings: numbers of the published method that a fold was asked for with."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"


def upgrade() -> None:
    """Migrate to this schema."""
    op.add_column("folds", sa.Column("settings", sa.String(500), nullable=False, server_default=""))
