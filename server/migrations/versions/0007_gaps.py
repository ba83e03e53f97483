"""Gaps: a fold whose clearance could not be bounded everywhere does not count as verified."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"

GAPS = "verified with gaps: "
"""Prefix of the verdict that earlier versions gave to folds whose clearance between modules could
not be bounded everywhere; the migration marks such folds as failed."""


def upgrade() -> None:
    """Migrate to this schema."""
    folds = sa.table(
        "folds",
        sa.column("id", sa.String),
        sa.column("status", sa.String),
        sa.column("summary", sa.JSON),
        sa.column("error", sa.JSON),
    )
    connection = op.get_bind()
    query = sa.select(folds.c.id, folds.c.summary).where(folds.c.status == "verified")
    for fold_id, summary in connection.execute(query).all():
        certificate = (summary or {}).get("certificate") or {}
        verdict = str(certificate.get("verdict") or "")
        if not verdict.startswith(GAPS):
            continue
        reason = verdict.removeprefix(GAPS)
        connection.execute(
            sa.update(folds)
            .where(folds.c.id == fold_id)
            .values(
                status="failed",
                summary={**summary, "status": "failed", "reason": reason},
                error={"code": "not-verified", "detail": reason, "where": None},
            )
        )
