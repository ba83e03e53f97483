"""Numbers for modules, kept with their folds."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0016"
down_revision = "0015"


def upgrade() -> None:
    """Migrate to this schema."""
    op.create_table(
        "own_values",
        sa.Column(
            "fold_id",
            sa.String(32),
            sa.ForeignKey("folds.id", ondelete="CASCADE"),
            primary_key=True,
        ),
        sa.Column("told", sa.JSON, nullable=False),
    )
