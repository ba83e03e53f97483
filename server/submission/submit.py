"""Submissions: validation of requests for folds, and their entry into the queue."""

from __future__ import annotations

import contextlib
import hashlib
import json
import shutil
import time
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from foldback.planner.errors import InputError
from foldback.planner.pipeline.expected_cost import ExpectedCost
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.progress import STAGE_TEXTS
from foldback.planner.storage.file_names import PREPARED, REQUEST
from foldback.planner.storage.files import sync
from foldback.server.context import Context
from foldback.server.errors import Conflict, Unusable, not_stored
from foldback.server.files.uploads import Upload, not_read
from foldback.server.limits.disk_space import check_space
from foldback.server.limits.queue_room import Waiting, check_room
from foldback.server.processes.children import ChildError
from foldback.server.processes.read_task import MAX_DRAWN_CELLS
from foldback.server.settings import Settings
from foldback.server.store.fold_files import size_of
from foldback.server.store.folds import cost_of, new_id
from foldback.server.store.owner import Owner
from foldback.server.store.schema import FoldRow, columns_of
from foldback.server.submission.fold_inputs import Origin, Source, open_source


@dataclass(frozen=True, slots=True, kw_only=True)
class Submission:
    """Validated request for a fold.

    Attributes:
        upload: Bytes of the input.
        source: Origin of the input, with the request that it completes.
        visitor: Name of the visitor with its networks.
        owner: Owner of the new fold.
    """

    upload: Upload
    source: Source
    visitor: str
    owner: Owner

    @property
    def content_key(self) -> str:
        """Key that is equal for the same input, options and version; such folds are computed once.

        For folds that are not public it depends on the owner, so that clients do not learn what
        others have uploaded.
        """
        return self.key_of(self.owner.digest)

    def key_of(self, owner: str | None) -> str:
        """Return the content key of the submission for a given owner digest."""
        request, parent = self.source.request, self.source.parent
        parameters = {
            "format": "foldback-fold/1",
            "version": version("foldback"),
            "preset": request.preset,
            "seed": request.seed,
            "module_size": request.module_size,
            "content": self.upload.digest,
            **request.changed(),
            **({} if parent is None else {parent.use: parent.digest}),
            **({} if self.source.public else {"owner": owner}),
        }
        return hashlib.sha256(json.dumps(parameters, sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True, slots=True, kw_only=True)
class Receipt:
    """Result of a submission; ``is_own`` is True if the fold belongs to its submitter."""

    row: FoldRow
    is_own: bool
    existing: bool


def fold_origin(
    context: Context, origin: Origin, request: FoldRequest, *, visitor: str, owner: Owner
) -> Receipt:
    """Open the input that an origin names, and submit it.

    Raises:
        ServiceError: As in ``open_source`` and ``submit``.
    """
    with (
        open_source(context, origin, request) as (stream, source),
        context.uploads.stored(stream, source.request.filename) as upload,
    ):
        submission = Submission(upload=upload, source=source, visitor=visitor, owner=owner)
        return submit(context, submission)


def submit(context: Context, submission: Submission) -> Receipt:
    """Check a submission, store it durably, and put it into the queue.

    Raises:
        ServiceError: If the input cannot be used, or the queue or the disk is full.
    """
    if (existing := _known(context, submission)) is not None:
        return existing
    _check_room(context, submission.visitor)
    directory, source = submission.upload.directory, submission.source
    try:
        _write(directory, source)
        chain = _read(context, directory, source, submission.visitor)
        _note(directory, source)
        row = _row(submission, chain)
        context.store.folders.adopt(directory, row.id)
        added = _add(context, row, submission.owner)
    except OSError as error:
        raise not_stored("upload", error) from error
    if not added:
        if (existing := _known(context, submission)) is not None:
            return existing
        raise Conflict(
            "changed-meanwhile",
            "Another request for the same fold arrived first, but that fold has just ended; send "
            "the request again.",
        )
    return Receipt(row=row, is_own=True, existing=False)


def _row(submission: Submission, chain: dict[str, Any]) -> FoldRow:
    """Return the row of a new fold, whose files are in the directory of its upload.

    Args:
        submission: The submission.
        chain: Columns of the row that describe the chain.
    """
    source, parent = submission.source, submission.source.parent
    return FoldRow(
        id=new_id(),
        status="queued",
        created_at=time.time(),
        shape=source.shape,
        public=source.public,
        content_key=submission.content_key,
        visitor=submission.visitor,
        refold=parent.name if parent and parent.use == "refold" else None,
        smooths=parent.fold if parent and parent.use == "smooth" else None,
        bytes=size_of(submission.upload.directory),
        **chain,
        **columns_of(source.request),
    )


def _title(context: Context, shape: str | None) -> str | None:
    """Return the title of a gallery shape."""
    gallery_shape = None if shape is None else context.gallery.shape(shape)
    return None if gallery_shape is None else gallery_shape.title


def _known(context: Context, submission: Submission) -> Receipt | None:
    """Return the existing equal fold: the owner's, a gallery fold, or the repeated one."""
    key, repeated = submission.content_key, submission.source.repeats
    if repeated is not None and repeated.content_key == (
        their_key := submission.key_of(repeated.owner)
    ):
        key = their_key
    row = context.store.ask(key, submission.owner)
    if row is None:
        return None
    return Receipt(row=row, is_own=submission.owner.owns(row.owner), existing=True)


def _check_room(context: Context, visitor: str) -> None:
    settings = context.settings
    check_room(context.store.waiting(), Waiting(visitor, 0.0), settings)
    check_space(settings.root, settings.min_free_disk_bytes)


def _add(context: Context, row: FoldRow, owner: Owner) -> bool:
    """Add a fold to the queue; return False if its content key exists already.

    If it is not added, its files are deleted.

    Raises:
        TooMany: If the queue has no room for it.
        Unusable: If it cannot end within the limits.
    """
    store, cost = context.store, cost_of(row)
    try:
        _check_limits(cost, context.settings)
        with store.admitting:
            newcomer = Waiting(row.visitor, cost.expected_s)
            check_room(store.waiting(), newcomer, context.settings)
            added = store.add(row, owner)
    except Exception:
        with contextlib.suppress(Exception):
            store.folders.remove(row.id)
        raise
    if not added:
        store.folders.remove(row.id)
    return added


def _check_limits(cost: ExpectedCost, settings: Settings) -> None:
    """Refuse a fold if one of its stages exceeds its time limit even in the best case.

    Raises:
        Unusable: If a stage takes too long (``too-long``).
    """
    limit_s = min(settings.stage_seconds, settings.stage_cpu_seconds)
    if cost.least_s > limit_s:
        raise Unusable(
            "too-long",
            f"got {cost.cause}, expected a fold whose stages take at most {{limit_s:g}} s each; "
            f"this fold takes at least {{least_s:.0f}} s for {STAGE_TEXTS[cost.stage]}. "
            f"{cost.remedy}",
            limit_s=limit_s,
            least_s=cost.least_s,
            stage=cost.stage,
        )


def _write(directory: Path, source: Source) -> None:
    """Write the request and the files of its parent durably."""
    if source.parent is not None:
        source.parent.copy(directory)
        for name in source.parent.files:
            sync(directory / name)
    (directory / REQUEST).write_text(json.dumps(source.request.to_json()))
    sync(directory / REQUEST)
    sync(directory)


def _note(directory: Path, source: Source) -> None:
    """Store the results of a preview: cells for the page's first drawing, and chains."""
    if source.cells and len(source.cells) <= MAX_DRAWN_CELLS:
        (directory / "cells.json").write_text(json.dumps(source.cells))
    if source.prepared is not None:
        with contextlib.suppress(FileNotFoundError):  # the preview has just been deleted
            shutil.copyfile(source.prepared, directory / PREPARED)


def _read(context: Context, directory: Path, source: Source, visitor: str) -> dict[str, Any]:
    """Check the input in a directory; return its name, and the kind and number of its modules."""
    parent = source.parent
    try:
        check = context.reader.call("check", directory, visitor=visitor)
    except InputError as error:
        if parent is None:
            raise
        raise context.gallery.advised(error, parent.module, parent.modules) from None
    except ChildError as error:
        raise not_read(error) from None
    modules = int(check["modules"])
    if modules > context.settings.max_modules:
        raise Unusable(
            "too-many-modules",
            "got a chain of {count} modules, expected at most {limit}; use a coarser shape.",
            count=modules,
            limit=context.settings.max_modules,
        )
    name = _title(context, source.shape) or str(check["name"])[:200]
    return {
        "name": name,
        "module": str(check["module"]),
        "module_words": check["module_words"],
        "modules": modules,
    }
