"""Parent folds: finished folds that refolds start from or whose plans are smoothed."""

from __future__ import annotations

import hashlib
import json
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal

from foldback.planner.chain.built_in_modules import module_of
from foldback.planner.storage.file_names import CHAIN, PLAN, RECORDED_PLAN, START_CHAIN, START_PLAN
from foldback.planner.verification.integrity import check
from foldback.server.context import Context
from foldback.server.errors import Conflict, Unusable
from foldback.server.store.schema import FoldRow

Use = Literal["refold", "smooth"]
COPIED_FILES: Final[dict[str, dict[str, str]]] = {
    "refold": {START_CHAIN: CHAIN, START_PLAN: PLAN},
    "smooth": {RECORDED_PLAN: PLAN, START_CHAIN: CHAIN},
}
"""Files that a new fold takes over from a finished one, by purpose ("refold": fold the folded chain
into another shape; "smooth": smooth its plan). Each entry maps the name in the new fold to the name
in the finished fold."""
COPIED_NAMES: Final = tuple(name for files in COPIED_FILES.values() for name in files)
"""Names, in a new fold, of the files that it takes over from a finished fold; they exist before its
computation."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ParentFold:
    """Finished fold that a refold starts from, or whose plan is smoothed.

    Attributes:
        use: ``refold`` or ``smooth``.
        fold: Its id; None if only its files are known.
        name: Name of its shape.
        module, modules: Kind and number of its chain's modules.
        files: Paths of the files by their names in the new fold.
        digest: Digest of the plan's content.
    """

    use: Use
    fold: str | None
    name: str
    module: str
    modules: int
    files: dict[str, Path]
    digest: str

    def copy(self, directory: Path) -> None:
        """Copy its files to another fold's directory, so that the parent may be deleted."""
        for name, path in self.files.items():
            shutil.copyfile(path, directory / name)


def finished_parent(context: Context, fold_id: str, use: Use) -> ParentFold:
    """Return a finished fold as the base of another one.

    Raises:
        NoSuchFoldError: If there is no such fold.
        ServiceError: If it is not over, or ended without a plan.
    """
    row, directory = context.store.fold(fold_id), context.store.directory(fold_id)
    if not row.over:
        raise Conflict(
            f"{use}-not-ready",
            f"{{name}} is still {{status}}, expected a finished fold; {use} it when it has "
            "finished.",
            retry_after_s=5,
            name=row.name,
            status=row.status,
        )
    check(directory, *COPIED_FILES[use].values())
    files = {name: directory / source for name, source in COPIED_FILES[use].items()}
    return _parent(use, fold_id, row, files)


def stored_parent(directory: Path, row: FoldRow) -> ParentFold | None:
    """Return the base of a refold or of a smoothed plan; None of other folds."""
    if row.refold is None and row.smooths is None:
        return None
    use: Use = "refold" if row.smooths is None else "smooth"
    parent = _parent(use, row.smooths, row, {name: directory / name for name in COPIED_FILES[use]})
    return parent if row.refold is None else replace(parent, name=row.refold)


def _parent(use: Use, fold: str | None, row: FoldRow, files: dict[str, Path]) -> ParentFold:
    plan = files[START_PLAN if use == "refold" else RECORDED_PLAN]
    name = row.name
    try:
        attributes = json.loads(files[START_CHAIN].read_bytes())
        with open(plan, "rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
    except (OSError, ValueError) as error:
        raise Unusable(f"{use}-no-plan", "{name} has no plan; fold it again.", name=name) from error
    return ParentFold(
        use=use,
        fold=fold,
        name=name,
        module=module_of(attributes["module"]).name,
        modules=int(attributes["modules"]),
        files=files,
        digest=digest,
    )
