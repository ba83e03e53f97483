"""Requested folds: the fold in an address, for everyone, for its owner, and with its frames."""

from __future__ import annotations

from typing import Annotated, Final

from fastapi import Depends

from foldback.server.context import Here
from foldback.server.dependencies.owner_tokens import RequiredOwner, not_owner
from foldback.server.errors import Conflict, Forbidden, NotFound
from foldback.server.store.fold_files import frames_promised
from foldback.server.store.schema import FoldRow

NOT_FOLD_OWNER: Final = (
    "This is not the token of the fold's owner. A gallery fold that several clients requested "
    "has no owner, so no client can change it."
)
NOTHING_STORED: Final = "no tour and no numbers can be stored with it"


def existing_fold(fold_id: str, context: Here) -> FoldRow:
    """Return the row of the fold in the address."""
    return context.store.fold(fold_id)


ExistingFold = Annotated[FoldRow, Depends(existing_fold)]


def owned_fold(fold: ExistingFold, context: Here, owner: RequiredOwner) -> FoldRow:
    """Return the row of the fold in the address; refuse others than its owner."""
    check_private(fold, "it cannot be changed")
    if not context.store.owns(fold.id, owner):
        raise not_owner(NOT_FOLD_OWNER)
    return fold


OwnedFold = Annotated[FoldRow, Depends(owned_fold)]


def check_private(fold: FoldRow, denied: str) -> None:
    """Raise Forbidden for a gallery fold, with a clause that says what is denied."""
    if fold.public:
        detail = f"This is a gallery fold, which everyone can see; {denied}."
        raise Forbidden("public", detail)


def not_there(row: FoldRow, part: str) -> NotFound | Conflict:
    """Return the problem that a fold does not have a file, or not yet."""
    if row.over:
        reason = row.error.get("detail") if row.error else None
        because = " ({reason})" if reason else ""
        return NotFound(
            "no-such-artifact",
            f"This fold has ended with the status '{{status}}' and has no {part}{because}.",
            status=row.status,
            reason=reason,
        )
    return Conflict(
        "not-ready",
        f"The {part} does not exist yet: the fold is {{status}}. Try again later.",
        retry_after_s=1,
        status=row.status,
    )


def frames_of_own(fold: ExistingFold, context: Here, owner: RequiredOwner) -> int:
    """Return the number of frames of a fold with which its owner stores something.

    Raises:
        ServiceError: If the fold is public, has another owner, runs, or has no frames.
    """
    check_private(fold, NOTHING_STORED)
    if not context.store.owns(fold.id, owner):
        raise not_owner(NOT_FOLD_OWNER)
    if not fold.over:
        raise Conflict(
            "not-ready",
            "The fold is {status}. A tour, or numbers for the modules, can be stored when the fold "
            "has ended.",
            retry_after_s=1,
            status=fold.status,
        )
    frames = frames_promised(context.store.directory(fold.id))
    if not frames:
        raise not_there(fold, "frames")
    return frames


OwnFrames = Annotated[int, Depends(frames_of_own)]
