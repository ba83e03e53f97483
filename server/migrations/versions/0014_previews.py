"""Previews: rows of all of them, with their sizes; those of earlier versions are deleted."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0014"
down_revision = "0013"


def upgrade() -> None:
    """Migrate to this schema."""
    op.drop_table("previews")  # their files have no rows then, and the first sweep deletes them
    op.create_table(
        "previews",
        sa.Column("id", sa.String(32), primary_key=True),
        sa.Column("visitor", sa.String(64), nullable=False),
        sa.Column("owner", sa.String(64)),
        sa.Column("filename", sa.String(200)),
        sa.Column("bytes", sa.BigInteger, nullable=False),
        sa.Column("created_at", sa.Double, nullable=False),
        sa.Column("seen_at", sa.Double, nullable=False),
        sa.Column("name", sa.String(200), nullable=False),
        sa.Column("modules", sa.Integer, nullable=False),
        sa.Column("module", sa.String(32), nullable=False),
        sa.Column("key", sa.String(32), nullable=False),
        sa.Column("query", sa.String(300), nullable=False),
    )
    op.create_index("ix_previews_owner", "previews", ["owner"])
    op.create_table(
        "preview_reports",
        sa.Column(
            "preview_id",
            sa.String(32),
            sa.ForeignKey("previews.id", ondelete="CASCADE"),
            primary_key=True,
        ),
        sa.Column("key", sa.String(32), primary_key=True),
        sa.Column("foreign", sa.Boolean, nullable=False),
        sa.Column("bytes", sa.BigInteger, nullable=False),
    )
