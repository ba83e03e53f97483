"""Words for modules that foldback does not ship."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"


def upgrade() -> None:
    """Add what the modules of folds and previews are called; None if foldback ships them."""
    for table in ("folds", "previews"):
        op.add_column(table, sa.Column("module_words", sa.JSON))
