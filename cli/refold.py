"""``foldback refold``: unfold one shape and fold the chain into another, without a service."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from foldback.cli.inputs import read_input, read_plan, refuse
from foldback.cli.options import AsJson, PlanDirectory, Workers, takes
from foldback.cli.progress_bars import compute
from foldback.cli.summary import finish
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.chain_attributes import chain_from_attributes
from foldback.planner.errors import InputError
from foldback.planner.pipeline.fold_layout import replacing_fold
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stage
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.shape_writers import write_chain
from foldback.planner.progress import STAGES
from foldback.planner.readers.gallery import Gallery
from foldback.planner.storage.file_names import CHAIN, FIRST_FOLD_DIR, PLAN


@takes("preset", "settings", "seed", "module_size", "strategy", "at_once")
def refold(
    *,
    start: Annotated[
        str,
        typer.Argument(
            metavar="A", help="Folder written by `foldback fold`, or a shape to fold first."
        ),
    ],
    shape: Annotated[
        str,
        typer.Argument(
            metavar="B",
            help="Shape to fold into, or folder written by `foldback fold`. The shape must have as "
            "many modules as A, of the same kind.",
        ),
    ],
    out: PlanDirectory,
    request: FoldRequest,
    workers: Workers = None,
    as_json: AsJson = False,
) -> None:
    """Unfold a folded chain and fold it into another shape; exits like `fold`."""
    begins: Chain | None = None
    summary: dict[str, Any] = {}
    try:
        folded = _plan(start)
        with replacing_fold(out) as place:
            workspace, first = Workspace(place), place / FIRST_FOLD_DIR
            if folded is None:
                begins = _read_first(start, request, first)
            else:
                begins = folded.unfolding().chain
            workspace.write_start_chain(begins)
            workspace.write_request(*_second(shape, request, begins))
            run_stage(STAGES[0], place)
            if folded is None:
                summary = compute(first, workers)
                folded = _straight_first(first)
            if folded is not None:
                workspace.write_start(folded)
                summary = compute(place, workers)
    except InputError as error:
        if begins is not None:
            error = Gallery().advised(error, begins.module.name, len(begins))
        refuse(error, as_json)
    finish(summary, out / FIRST_FOLD_DIR if folded is None else out, as_json)


def _read_first(start: str, request: FoldRequest, first: Path) -> Chain:
    """Write the request for a fold of the start shape, and return the shape's chain.

    Raises:
        InputError: The shape cannot be used.
    """
    data, filename = read_input(start)
    first.mkdir()
    Workspace(first).write_request(replace(request, filename=filename), data)
    run_stage(STAGES[0], first)
    return chain_from_attributes(json.loads((first / CHAIN).read_bytes()))


def _straight_first(first: Path) -> Plan | None:
    """Return the plan of the start shape; None if it does not lead from straight to folded."""
    plan = Plan.load(first / PLAN)
    try:
        plan.unfolding()
    except InputError:
        return None
    return plan


def _plan(name: str) -> Plan | None:
    """Return the plan in a directory; None if the path is not a directory."""
    return read_plan(Path(name)) if Path(name).is_dir() else None


def _second(name: str, request: FoldRequest, begins: Chain) -> tuple[FoldRequest, bytes]:
    """Return the options and the bytes of the second shape."""
    request = replace(request, refold=True)
    plan = _plan(name)
    if plan is not None:
        return replace(request, filename=f"{plan.chain.name}.json"), write_chain(plan.chain)
    data, filename = read_input(name)
    if Path(name).exists():  # an example defines its own modules
        request = replace(request, module=begins.module.name, modules=len(begins))
    return replace(request, filename=filename), data
