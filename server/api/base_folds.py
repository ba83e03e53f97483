"""Beginnings: the finished folds that refolds begin with, and whose plans are smoothed."""

from __future__ import annotations

import hashlib
import json
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal

from planner.playback.unfolding import START_CHAIN, START_PLAN
from planner.robot import RECORDED_PLAN
from planner.verification.integrity import check
from server.api.context import Context
from server.errors import Conflict, Unusable
from server.store.tables import FoldRow

Use = Literal["refold", "smooth"]
FILES: Final[dict[str, dict[str, str]]] = {
    "refold": {START_CHAIN: "chain.json", START_PLAN: "plan.npz"},
    "smooth": {RECORDED_PLAN: "plan.npz", START_CHAIN: "chain.json"},
}
"""Files copied for each use: their names here, and in the finished fold."""
BROUGHT: Final = tuple(name for files in FILES.values() for name in files)
"""Files that a fold may have before it begins, beside its input."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseFold:
    """What a refold begins with, or what is smoothed: a fold, by files that are copied.

    Attributes:
        use: What is made of it.
        fold: Its id; None when it is only known by its files.
        name: What people call its shape.
        module, modules: What its chain is made of.
        files: Where the files are, by what they are called when copied.
        digest: Of the plan's content.
    """

    use: Use
    fold: str | None
    name: str
    module: str
    modules: int
    files: dict[str, Path]
    digest: str

    def copy(self, directory: Path) -> None:
        """Copies its files into another fold's directory, so that the fold may be deleted."""
        for name, path in self.files.items():
            shutil.copyfile(path, directory / name)


def beginning_of(context: Context, fold_id: str, use: Use) -> BaseFold:
    """A finished fold, as what another one is made of.

    Raises:
        NoSuchFoldError: When there is no such fold.
        ServiceError: When it is not over, or ended without a plan.
    """
    row, directory = context.store.fold(fold_id), context.store.directory(fold_id)
    if not row.over:
        raise Conflict(
            f"{use}-not-ready",
            f"{row.name} is still {row.status}, expected a finished fold; {use} it when the fold "
            "is over.",
            retry_after_s=5,
        )
    check(directory, *FILES[use].values())
    files = {name: directory / source for name, source in FILES[use].items()}
    return _beginning(use, fold_id, row, files)


def beginning_noted(directory: Path, row: FoldRow) -> BaseFold | None:
    """What a fold was made of that is a refold or smoothed; None when it is neither."""
    if row.refold is None and row.smooths is None:
        return None
    use: Use = "refold" if row.smooths is None else "smooth"
    found = _beginning(use, row.smooths, row, {name: directory / name for name in FILES[use]})
    return found if row.refold is None else replace(found, name=row.refold)


def _beginning(use: Use, fold: str | None, row: FoldRow, files: dict[str, Path]) -> BaseFold:
    plan = files[START_PLAN if use == "refold" else RECORDED_PLAN]
    name = row.name
    try:
        attributes = json.loads(files[START_CHAIN].read_bytes())
        with open(plan, "rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
    except (OSError, ValueError) as error:
        raise Unusable(
            f"{use}-no-plan",
            f"{name} has no plan, expected a fold with a plan; fold it again.",
        ) from error
    return BaseFold(
        use=use,
        fold=fold,
        name=name,
        module=str(attributes["module"]),
        modules=int(attributes["modules"]),
        files=files,
        digest=digest,
    )
