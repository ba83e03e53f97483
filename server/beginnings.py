"""Beginnings: what refolds begin with, which is a finished fold."""

from __future__ import annotations

import hashlib
import json
import shutil
from dataclasses import dataclass
from pathlib import Path

from planner.unfolding import START_CHAIN, START_PLAN
from server.context import Context
from server.problems import Problem


@dataclass(frozen=True, slots=True, kw_only=True)
class Beginning:
    """What a refold begins with: a fold, by files that are copied.

    Attributes:
        name: What people call its shape.
        module, modules: What its chain is made of.
        chain, plan: Its files.
        digest: Of the plan's content.
    """

    name: str
    module: str
    modules: int
    chain: Path
    plan: Path
    digest: str

    def copy(self, directory: Path) -> None:
        """Copies its files into the directory of a refold, so that the fold may be deleted."""
        shutil.copyfile(self.chain, directory / START_CHAIN)
        shutil.copyfile(self.plan, directory / START_PLAN)


def beginning_of(context: Context, fold_id: str) -> Beginning:
    """A finished fold, as what a refold begins with.

    Raises:
        NoSuchFoldError: When there is no such fold.
        Problem: When it is not over (409), or ended without a plan (422).
    """
    row, directory = context.store.fold(fold_id), context.store.directory(fold_id)
    if not row.over:
        raise Problem(
            409,
            "refold-not-ready",
            f"{row.name} is still {row.status}, expected a finished fold; refold it when it is "
            "over.",
            headers={"Retry-After": "5"},
        )
    return _beginning(directory, "plan.npz", "chain.json", row.name)


def beginning_noted(directory: Path, name: str | None) -> Beginning | None:
    """What a fold that is a refold began with; None when it began straight."""
    return None if name is None else _beginning(directory, START_PLAN, START_CHAIN, name)


def _beginning(directory: Path, plan: str, chain: str, name: str) -> Beginning:
    try:
        attributes = json.loads((directory / chain).read_bytes())
        with open(directory / plan, "rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
    except (OSError, ValueError) as error:
        raise Problem(
            422,
            "refold-no-plan",
            f"{name} ended without a plan, expected a fold that has one; fold it again.",
        ) from error
    return Beginning(
        name=name,
        module=str(attributes["module"]),
        modules=int(attributes["modules"]),
        chain=directory / chain,
        plan=directory / plan,
        digest=digest,
    )
