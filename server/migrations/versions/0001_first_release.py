"""Schema of the first release."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None


def upgrade() -> None:
    """Create the schema."""
    _create_folds()
    _create_parts_of_folds()
    _create_previews()
    _create_shared()


def _create_folds() -> None:
    """Create the rows of folds."""
    op.create_table(
        "folds",
        sa.Column("id", sa.String(32), nullable=False),
        sa.Column("name", sa.String(200), nullable=False),
        sa.Column("status", sa.String(16), nullable=False),
        sa.Column("stage", sa.String(16)),
        sa.Column("created_at", sa.Double, nullable=False),
        sa.Column("started_at", sa.Double),
        sa.Column("ended_at", sa.Double),
        sa.Column("modules", sa.Integer, nullable=False),
        sa.Column("module", sa.String(32), nullable=False),
        sa.Column("shape", sa.String(64)),
        sa.Column("public", sa.Boolean, nullable=False),
        sa.Column("preset", sa.String(32), nullable=False),
        sa.Column("seed", sa.BigInteger, nullable=False),
        sa.Column("module_size", sa.Double),
        sa.Column("content_key", sa.String(64)),
        sa.Column("visitor", sa.String(64), nullable=False),
        sa.Column("cancel_requested", sa.Boolean, nullable=False),
        sa.Column("progress", sa.JSON, nullable=False),
        sa.Column("summary", sa.JSON, nullable=False),
        sa.Column("error", sa.JSON),
        sa.Column("refold", sa.String(200)),
        sa.Column("turn", sa.BigInteger, nullable=False),
        sa.Column("cost_s", sa.Double, nullable=False),
        sa.Column("worker", sa.String(200)),
        sa.Column("epoch", sa.Integer, nullable=False),
        sa.Column("kept", sa.Integer, nullable=False),
        sa.Column("bytes", sa.BigInteger, nullable=False),
        sa.Column("seen_at", sa.Double, nullable=False),
        sa.Column("pinned", sa.Boolean, nullable=False),
        sa.Column("strategy", sa.String(16), nullable=False),
        sa.Column("smooths", sa.String(32)),
        sa.Column("settings", sa.String(500), nullable=False),
        sa.Column("owner", sa.String(64)),
        sa.Column("derived_bytes", sa.BigInteger, nullable=False),
        sa.Column("prefer", sa.String(16), nullable=False),
        sa.Column("maker", sa.String(64)),
        sa.Column("renamed", sa.Boolean, nullable=False),
        sa.Column("world", sa.String(16), nullable=False),
        sa.Column("pauses", sa.Integer, nullable=False),
        sa.Column("resumed_at", sa.Double),
        sa.Column("checkpoint", sa.JSON),
        sa.Column("losses", sa.Integer, nullable=False),
        sa.PrimaryKeyConstraint("id"),
        sa.UniqueConstraint("content_key"),
    )
    op.create_index("ix_folds_created_at", "folds", ["created_at"])
    op.create_index("ix_folds_maker", "folds", ["maker"])
    op.create_index("ix_folds_owner", "folds", ["owner"])
    op.create_index("ix_folds_public_status", "folds", ["public", "status"])
    op.create_index("ix_folds_status_seen_at", "folds", ["status", "seen_at"])
    op.create_index("ix_folds_visitor_status_seen_at", "folds", ["visitor", "status", "seen_at"])
    op.create_index("ix_folds_worker", "folds", ["worker"])


def _create_parts_of_folds() -> None:
    """Create the rows of what belongs to a fold: movies, tours and module values."""
    op.create_table(
        "movies",
        sa.Column("fold_id", sa.String(32), nullable=False),
        sa.Column("id", sa.String(32), nullable=False),
        sa.Column("job", sa.String(128), nullable=False),
        sa.Column("wishes", sa.JSON, nullable=False),
        sa.Column("visitor", sa.String(64), nullable=False),
        sa.Column("token_hash", sa.String(64), nullable=False),
        sa.Column("status", sa.String(16), nullable=False),
        sa.Column("frames_done", sa.Integer, nullable=False),
        sa.Column("problem", sa.JSON),
        sa.Column("created_at", sa.Double, nullable=False),
        sa.Column("bytes", sa.BigInteger, nullable=False),
        sa.Column("of_owner", sa.Boolean, nullable=False),
        sa.Column("worker", sa.String(200)),
        sa.Column("losses", sa.Integer, nullable=False),
        sa.ForeignKeyConstraint(["fold_id"], ["folds.id"], ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("fold_id", "id"),
        sa.UniqueConstraint("job"),
    )
    op.create_index("ix_movies_status", "movies", ["status"])
    op.create_index("ix_movies_token_hash", "movies", ["token_hash"])
    op.create_index("ix_movies_worker", "movies", ["worker"])
    op.create_table(
        "tours",
        sa.Column("fold_id", sa.String(32), nullable=False),
        sa.Column("tour", sa.JSON, nullable=False),
        sa.ForeignKeyConstraint(["fold_id"], ["folds.id"], ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("fold_id"),
    )
    op.create_table(
        "own_values",
        sa.Column("fold_id", sa.String(32), nullable=False),
        sa.Column("told", sa.JSON, nullable=False),
        sa.ForeignKeyConstraint(["fold_id"], ["folds.id"], ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("fold_id"),
    )


def _create_previews() -> None:
    """Create the rows of previews."""
    op.create_table(
        "previews",
        sa.Column("id", sa.String(32), nullable=False),
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
        sa.PrimaryKeyConstraint("id"),
    )
    op.create_index("ix_previews_owner", "previews", ["owner"])
    op.create_table(
        "preview_reports",
        sa.Column("preview_id", sa.String(32), nullable=False),
        sa.Column("key", sa.String(32), nullable=False),
        sa.Column("foreign", sa.Boolean, nullable=False),
        sa.Column("bytes", sa.BigInteger, nullable=False),
        sa.ForeignKeyConstraint(["preview_id"], ["previews.id"], ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("preview_id", "key"),
    )


def _create_shared() -> None:
    """Create the rows that all processes of a service share."""
    op.create_table(
        "workers",
        sa.Column("name", sa.String(200), nullable=False),
        sa.Column("host", sa.String(200), nullable=False),
        sa.Column("pid", sa.Integer, nullable=False),
        sa.Column("beat", sa.BigInteger, nullable=False),
        sa.Column("folds_at_once", sa.Integer, nullable=False),
        sa.Column("started_at", sa.Double, nullable=False),
        sa.Column("version", sa.String(32), nullable=False),
        sa.PrimaryKeyConstraint("name"),
    )
    counters = op.create_table(
        "counters",
        sa.Column("name", sa.String(32), nullable=False),
        sa.Column("value", sa.BigInteger, nullable=False),
        sa.PrimaryKeyConstraint("name"),
    )
    op.bulk_insert(counters, [{"name": "turn", "value": 0}])
    op.create_table(
        "secrets",
        sa.Column("name", sa.String(32), nullable=False),
        sa.Column("value", sa.LargeBinary, nullable=False),
        sa.PrimaryKeyConstraint("name"),
    )
