"""Tours: captions for frames, kept with their folds."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0015"
down_revision = "0014"


def upgrade() -> None:
    """Migrate to this schema."""
    op.create_table(
        "tours",
        sa.Column(
            "fold_id",
            sa.String(32),
            sa.ForeignKey("folds.id", ondelete="CASCADE"),
            primary_key=True,
        ),
        sa.Column("tour", sa.JSON, nullable=False),
    )
