"""Exports: files computed from a finished fold on request, and stored beside it."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Final
from zipfile import BadZipFile

from foldback.planner.errors import InputError
from foldback.planner.exports.export import Export
from foldback.planner.motion.angle_encoding import unpacked_bytes
from foldback.planner.readers.limits import megabytes
from foldback.planner.storage.file_names import PLAN
from foldback.planner.verification.integrity import check
from foldback.server.errors import NotFound, TooLarge
from foldback.server.files.artifacts import Artifacts
from foldback.server.store.folds import Store

MAX_EXPORTED_PLAN_BYTES: Final = 64 * 2**20
"""Maximum unpacked size of a plan that the service exports to other formats, in bytes; larger plans
are left to the command line. Some formats need ten times as much memory."""


async def export_file(
    store: Store, artifacts: Artifacts, fold_id: str, export: Export, *, visitor: str | None = None
) -> Path:
    """Return the path of a finished fold's export; compute it unless it is up to date.

    Args:
        store: Store of the folds.
        artifacts: Computes and stores the file.
        fold_id: The fold.
        export: Format of the file.
        visitor: Visitor that requests it.

    Raises:
        NoSuchFoldError: If there is no such fold.
        ServiceError: If the plan has no such export or is too large for the service, too many
            exports are being computed, or the disk is full.
    """
    directory = await asyncio.to_thread(store.directory, fold_id)
    await asyncio.to_thread(check, directory, PLAN, export.filename)
    stored_path = directory / export.filename
    if await asyncio.to_thread(stored_path.is_file):
        return stored_path  # the fold's own stages have written it
    return await artifacts.file(
        fold_id,
        directory,
        export.filename,
        lambda: _written(directory / PLAN, export),
        of=PLAN,
        visitor=visitor,
    )


def _written(path: Path, export: Export) -> bytes:
    # Imported late, because it loads the physics, which would delay the start of the server.
    from foldback.planner.plan.plan import Plan

    # Models of robots hold no frames; all other exports do.
    if (export.moving or export.name == "json") and (
        size := _unpacked(path)
    ) > MAX_EXPORTED_PLAN_BYTES:
        raise TooLarge(
            "too-large",
            f"got a plan of {megabytes(size)}, expected at most "
            f"{megabytes(MAX_EXPORTED_PLAN_BYTES)}; download {PLAN} and use `foldback export`.",
            bytes=size,
            max_bytes=MAX_EXPORTED_PLAN_BYTES,
        )
    try:
        return export.write(Plan.load(path))
    except InputError as error:
        if error.code == "too-many-steps":
            raise TooLarge(error.code, error.detail) from error
        raise NotFound("no-such-artifact", error.detail, where=error.where) from error


def _unpacked(path: Path) -> int:
    """Return the size of a plan's arrays; 0 if unreadable, which ``Plan.load`` reports better."""
    try:
        return unpacked_bytes(path)
    except (OSError, BadZipFile):
        return 0
