"""One owner: a fold has one or none; what can be made again is counted apart from its own files."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"


def upgrade() -> None:
    """Migrate to this schema."""
    op.add_column("folds", sa.Column("owner", sa.String(64)))
    op.add_column(
        "folds", sa.Column("derived_bytes", sa.BigInteger, nullable=False, server_default="0")
    )
    op.add_column(
        "movies", sa.Column("of_owner", sa.Boolean, nullable=False, server_default=sa.false())
    )
    op.create_index("ix_folds_owner", "folds", ["owner"])
    folds = sa.table(
        "folds",
        *(sa.column(name) for name in ("id", "owner", "public", "status", "content_key", "bytes")),
    )
    owners = sa.table(
        "owners", *(sa.column(name) for name in ("fold_id", "token_hash", "created_at"))
    )
    movies = sa.table("movies", *(sa.column(name) for name in ("fold_id", "bytes")))
    # Who sent it is its owner; others had only sent the same, or its link.
    first = (
        sa.select(owners.c.token_hash)
        .where(owners.c.fold_id == folds.c.id)
        .order_by(owners.c.created_at, owners.c.token_hash)
        .limit(1)
        .scalar_subquery()
    )
    op.execute(sa.update(folds).values(owner=first))
    several = sa.select(sa.func.count()).where(owners.c.fold_id == folds.c.id).scalar_subquery() > 1
    public = folds.c.public == sa.true()
    op.execute(sa.update(folds).where(public, several).values(owner=None))
    # The key of a private fold has its owner in it from now on.
    op.execute(sa.update(folds).where(sa.not_(public)).values(content_key=None))
    # Movies were counted as the fold's own.
    filmed = (
        sa.select(sa.func.coalesce(sa.func.sum(movies.c.bytes), 0))
        .where(movies.c.fold_id == folds.c.id)
        .scalar_subquery()
    )
    op.execute(
        sa.update(folds).values(
            bytes=sa.case((folds.c.bytes > filmed, folds.c.bytes - filmed), else_=0)
        )
    )
    # What was cancelled in the queue was not counted; one byte has its files swept.
    uncounted = sa.and_(folds.c.status == "cancelled", folds.c.bytes == 0)
    op.execute(sa.update(folds).where(uncounted).values(bytes=1))
    op.drop_table("owners")
