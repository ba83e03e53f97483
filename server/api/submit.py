"""Submissions: how an upload, or a shape of the gallery, becomes a fold in the queue."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shutil
import time
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, BinaryIO

from planner.errors import InputError
from planner.file_names import PREPARED
from planner.files import json_of
from planner.pathfinding.options import PathOptions
from planner.pipeline.expected_cost import ExpectedCost
from planner.pipeline.request import FoldRequest
from planner.verification.integrity import check
from server.api.base_folds import BaseFold
from server.api.context import Context
from server.errors import Conflict, NotFound, Unavailable, Unusable, nearly_full, not_stored
from server.files.uploads import Upload
from server.limits.queue_room import Waiting, check_room
from server.processes.children import ChildError
from server.processes.read_task import MAX_STORED_CELLS
from server.settings import Settings
from server.store.fold_files import size_of, sync
from server.store.folds import cost_of, hash_of, new_id
from server.store.tables import FoldRow


@dataclass(frozen=True, slots=True, kw_only=True)
class Submission:
    """Validated request for a fold."""

    upload: Upload
    shape: str | None
    request: FoldRequest
    """Canonical request, see ``FoldRequest.canonical``."""
    visitor: str
    token: str
    """Of who asks: he owns what is made for him."""
    cells: list[list[int]] | None = None
    """For a drawing until there is a chain; those that a preview has found."""
    prepared: Path | None = None
    """File of the chains that a preview has found."""
    beginning: BaseFold | None = None
    again: FoldRow | None = None
    """The fold that is asked for once more, by its id."""

    @property
    def public(self) -> bool:
        """True if everyone may find it: a gallery shape, folded with the default options."""
        default = not self.request.changed()
        return self.shape is not None and self.beginning is None and default

    @property
    def refolds(self) -> BaseFold | None:
        """Fold that a refold starts from, or None."""
        return self.beginning if self.beginning and self.beginning.use == "refold" else None

    @property
    def smooths(self) -> BaseFold | None:
        """Fold whose plan is to be smoothed, or None."""
        return self.beginning if self.beginning and self.beginning.use == "smooth" else None

    @property
    def content_key(self) -> str:
        """The same for the same bytes, parameters and version: such folds are computed once.

        One that is not public has its owner in it, so that nobody learns what others have sent.
        """
        return self.key_of(hash_of(self.token))

    def key_of(self, owner: str | None) -> str:
        """Return its content key, also if it belongs to a visitor."""
        parameters = {
            "format": "foldback-fold/1",
            "version": version("foldback"),
            "preset": self.request.preset,
            "seed": self.request.seed,
            "module_size": self.request.module_size,
            "content": self.upload.digest,
            **self.request.changed(),
            **({} if self.beginning is None else {self.beginning.use: self.beginning.digest}),
            **({} if self.public else {"owner": owner}),
        }
        return hashlib.sha256(json.dumps(parameters, sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True, slots=True, kw_only=True)
class Receipt:
    """Answer to a submission; it holds a token only for a fold of the visitor's own."""

    row: FoldRow
    token: str | None
    existing: bool


def submit(context: Context, submission: Submission) -> Receipt:
    """Accepts a submission: checks it, keeps it safe, and puts it into the queue.

    Raises:
        ServiceError: When it can't be used, there is too much to do, or no room.
    """
    if (known := _known(context, submission)) is not None:
        return known
    _check_room(context, submission)
    fold_id = new_id()
    aside = submission.upload.directory
    try:
        _write(aside, submission)
        found = _read(context, aside, submission.beginning, submission.visitor)
        _note(aside, submission)
        size = size_of(aside)
        context.store.folders.adopt(aside, fold_id)
        row = FoldRow(
            id=fold_id,
            name=_title(context, submission.shape) or found.name,
            status="queued",
            stage=None,
            created_at=time.time(),
            started_at=None,
            ended_at=None,
            modules=found.modules,
            module=found.module,
            shape=submission.shape,
            public=submission.public,
            preset=submission.request.preset,
            settings=submission.request.settings,
            seed=submission.request.seed,
            module_size=submission.request.module_size,
            content_key=submission.content_key,
            visitor=submission.visitor,
            cancel_requested=False,
            progress={},
            summary={},
            error=None,
            world=submission.request.world,
            refold=submission.refolds and submission.refolds.name,
            strategy=submission.request.strategy,
            prefer=submission.request.prefer,
            smooths=submission.smooths and submission.smooths.fold,
            bytes=size,
        )
        try:
            added = _add(context, row, submission.token)
        except Exception:  # it was not acknowledged, and nothing of it stays
            with contextlib.suppress(Exception):
                context.store.folders.remove(fold_id)
            raise
        if not added:
            context.store.folders.remove(fold_id)
            if (known := _known(context, submission)) is not None:
                return known
            raise Conflict(
                "changed-meanwhile", "The same fold has just finished; send the request again."
            )
    except OSError as error:
        raise not_stored("upload", error) from error
    finally:
        shutil.rmtree(aside, ignore_errors=True)
    context.jobs.enqueue(fold_id, row.turn, row.cost_s)
    return Receipt(row=row, token=submission.token, existing=False)


def input_noted(directory: Path) -> tuple[BinaryIO, str | None]:
    """Return the input of a fold, open, and the name of its file.

    Raises:
        NotFound: If it is not there any more.
        DamagedError: If it is not what was written.
    """
    try:
        source = open(directory / "input", "rb")  # noqa: SIM115 (the caller closes it)
    except OSError as error:
        raise _no_input() from error
    try:
        check(directory, "input", "request.json")
        return source, _request(directory)["filename"]
    except BaseException:
        source.close()
        raise


def _request(directory: Path) -> dict[str, Any]:
    request = json_of(directory / "request.json")
    if "filename" not in request:
        raise _no_input()
    return request


def _no_input() -> NotFound:
    return NotFound("no-input", "The input file of this fold has expired; send the file again.")


def noted(directory: Path) -> tuple[PathOptions, list[list[int]] | None]:
    """Return a fold's options for its path, and its cells for a drawing if there are any.

    Raises:
        NotFound: When they are not there any more.
    """
    options = PathOptions.from_json(_request(directory))
    try:
        cells = json.loads((directory / "cells.json").read_bytes())
    except (OSError, ValueError):
        cells = None
    return options, cells


@dataclass(frozen=True, slots=True, kw_only=True)
class _Found:
    name: str
    module: str
    modules: int


def _title(context: Context, shape: str | None) -> str | None:
    """Return the title of a gallery shape."""
    found = None if shape is None else context.gallery.shape(shape)
    return None if found is None else found.title


def _known(context: Context, submission: Submission) -> Receipt | None:
    """Return the existing fold: the visitor's own, one of the gallery, or that of a link."""
    key, again = submission.content_key, submission.again
    if again is not None and again.content_key == (theirs := submission.key_of(again.owner)):
        key = theirs
    row = context.store.ask(key, submission.token)
    if row is None:
        return None
    if row.status == "queued":  # if its job was lost in a crash, this brings it back
        context.jobs.enqueue(row.id, row.turn, row.cost_s)
    own = row.owner == hash_of(submission.token)
    return Receipt(row=row, token=submission.token if own else None, existing=True)


def _check_room(context: Context, submission: Submission) -> None:
    settings = context.settings
    check_room(_waiting(context), Waiting(submission.visitor, 0.0), settings)
    if shutil.disk_usage(settings.root).free < settings.min_free_disk_bytes:
        raise nearly_full()


def _waiting(context: Context) -> list[Waiting]:
    return [Waiting(visitor, cost_s) for visitor, cost_s in context.store.waiting()]


def _add(context: Context, row: FoldRow, token: str) -> bool:
    """Add a fold that the queue has room for; False if its content key is taken.

    Raises:
        TooMany: If the queue has no room for it.
        Unusable: If it cannot end within the limits.
    """
    cost = cost_of(row)
    _check_limits(cost, context.settings)
    with context.store.admitting:
        check_room(_waiting(context), Waiting(row.visitor, cost.expected_s), context.settings)
        return context.store.add(row, token)


def _check_limits(cost: ExpectedCost, settings: Settings) -> None:
    """Refuse a fold of which one stage takes longer than it may, even if all goes well.

    Raises:
        Unusable: ``too-long``.
    """
    limit_s = min(settings.stage_seconds, settings.stage_cpu_seconds)
    if cost.least_s > limit_s:
        raise Unusable(
            "too-long",
            f"got {cost.cause}, expected a fold whose stages take at most {limit_s:g} s each; this "
            f"one takes at least {cost.least_s:.0f} s in the stage '{cost.stage}'. "
            f"{cost.remedy}",
        )


def _write(directory: Path, submission: Submission) -> None:
    request = replace(
        submission.request,
        filename=submission.upload.filename,
        refold=submission.refolds is not None,
        smooth=submission.smooths is not None,
    )
    if submission.beginning is not None:
        submission.beginning.copy(directory)
        for name in submission.beginning.files:
            sync(directory / name)
    with open(directory / "request.json", "w") as file:
        json.dump(request.to_json(), file)
        file.flush()
        os.fsync(file.fileno())
    sync(directory)


def _note(directory: Path, submission: Submission) -> None:
    """Store what a preview has found: cells for the page's first drawing, and chains."""
    if submission.cells and len(submission.cells) <= MAX_STORED_CELLS:
        (directory / "cells.json").write_text(json.dumps(submission.cells))
    if submission.prepared is not None:
        with contextlib.suppress(FileNotFoundError):  # the preview was just deleted
            shutil.copyfile(submission.prepared, directory / PREPARED)


def _read(context: Context, directory: Path, beginning: BaseFold | None, visitor: str) -> _Found:
    try:
        found = context.reader.check(directory, visitor=visitor)
    except InputError as error:
        if beginning is not None:
            error = context.gallery.advised(error, beginning.module, beginning.modules)
        raise Unusable.of(error) from None
    except ChildError as error:
        raise Unavailable(error.code, error.detail) from None
    modules = int(found["modules"])
    if modules > context.settings.max_modules:
        raise Unusable(
            "too-many-modules",
            f"got a chain of {modules} modules, expected at most {context.settings.max_modules}; "
            "use a coarser shape.",
        )
    return _Found(name=str(found["name"])[:200], module=str(found["module"]), modules=modules)
