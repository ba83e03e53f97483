"""``foldback refold``: unfold one shape and fold the chain into another, without a service."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from cli.inputs import make_directory, read_input, refuse
from cli.options import AsJson, PlanDirectory, Workers, takes
from cli.progress_bars import compute
from cli.summary import finish
from planner.chain.chain import Chain
from planner.errors import InputError
from planner.file_names import CHAIN, PLAN
from planner.motion.timeline import chain_from_attributes
from planner.pipeline.request import FoldRequest
from planner.pipeline.stages import run_stage
from planner.pipeline.workspace import Workspace
from planner.plan.plan import Plan
from planner.plan.shape_writers import write_chain
from planner.progress import STAGES
from planner.readers.gallery import Gallery

FIRST_FOLD_DIR = "start"
"""Subdirectory of the output directory in which the start shape is folded, if the user gives a
shape rather than a folded chain."""


@takes("preset", "settings", "seed", "module_size")
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
    first = out / FIRST_FOLD_DIR
    try:
        folded = _plan(start)
        if folded is None:
            data, filename = read_input(start)
            make_directory(first)
            Workspace(first).write_request(replace(request, filename=filename), data)
            run_stage(STAGES[0], first)
            begins = chain_from_attributes(json.loads((first / CHAIN).read_bytes()))
        else:
            begins = folded.unfolding().chain
        make_directory(out)
        Workspace(out).write_start_chain(begins)
        Workspace(out).write_request(*_second(shape, request, begins))
        run_stage(STAGES[0], out)
    except InputError as error:
        if begins is not None:
            error = Gallery().advised(error, begins.module.name, len(begins))
        refuse(error, as_json)
    if folded is None:
        summary = compute(first, workers)
        folded = Plan.load(first / PLAN)
        try:
            folded.unfolding()
        except InputError:
            finish(summary, first, as_json)
    Workspace(out).write_start(folded)
    finish(compute(out, workers), out, as_json)


def _plan(name: str) -> Plan | None:
    """Return the plan in a directory; None if the path is not a directory."""
    return Plan.load(Path(name) / PLAN) if Path(name).is_dir() else None


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
