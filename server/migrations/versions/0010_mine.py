"""Mine: who made a fold first, names that owners give, and previews in a list."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0010"
down_revision = "0009"


def upgrade() -> None:
    """Migrate to this schema."""
    op.add_column("folds", sa.Column("maker", sa.String(64)))
    op.add_column(
        "folds", sa.Column("renamed", sa.Boolean, nullable=False, server_default=sa.false())
    )
    op.create_index("ix_folds_maker", "folds", ["maker"])
    op.create_index("ix_movies_token_hash", "movies", ["token_hash"])
    folds = sa.table("folds", sa.column("owner"), sa.column("maker"))
    op.execute(sa.update(folds).values(maker=folds.c.owner))
    op.create_table(
        "previews",
        sa.Column("id", sa.String(32), primary_key=True),
        sa.Column("owner", sa.String(64), nullable=False),
        sa.Column("name", sa.String(200), nullable=False),
        sa.Column("modules", sa.Integer, nullable=False),
        sa.Column("module", sa.String(32), nullable=False),
        sa.Column("key", sa.String(32), nullable=False),
        sa.Column("query", sa.String(300), nullable=False),
        sa.Column("created_at", sa.Double, nullable=False),
        sa.Column("seen_at", sa.Double, nullable=False),
    )
    op.create_index("ix_previews_owner", "previews", ["owner"])
    op.create_index("ix_previews_seen_at", "previews", ["seen_at"])
