"""Reading: what the reader child does with uploads. Nothing of them is parsed anywhere else.

Solvers are loaded where they are needed: most uploads are paths.
"""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from planner.chain import Chain
from planner.errors import InputError
from planner.paths import Path as CellPath
from planner.readers import read
from planner.shapes import Shape

if TYPE_CHECKING:
    from planner.preparation import Preparation, Wishes

LARGEST_DRAWING: Final = 4000
READ_AS_VOXELS: Final = "Read as voxels, since the cells are not in the order of a path."
WISHES: Final = ("modules", "method", "repair", "ends", "as_voxels", "start")


def wishes_of(request: dict[str, Any]) -> Wishes:
    """The wishes in a request; those that are not there are as usual."""
    from planner.preparation import Wishes

    values = {name: request[name] for name in WISHES if name in request}
    if values.get("start") is not None:
        values["start"] = tuple(values["start"])
    wishes = Wishes(**values)
    wishes.check()
    return wishes


def check(directory: Path) -> dict[str, Any]:
    """Whether the input in a directory can become a fold: ``name``, ``module``, ``modules``.

    Paths are searched for later, when the fold's turn has come; only what is sure by now is said.

    Raises:
        InputError: When it can't.
    """
    request = json.loads((directory / "request.json").read_bytes())
    data = (directory / "input").read_bytes()
    more = {"as_voxels": True} if request.get("as_voxels") else {}
    found = read(data, filename=request["filename"], **more)
    if isinstance(found, CellPath):
        found = Chain.from_path(found)
    if isinstance(found, Chain):
        _note(directory, np.rint(found.folded_poses.positions))
        return {"name": found.name, "module": found.module.name, "modules": len(found)}
    from planner.preparation import BLOCK, DEFAULT_MODULES

    wishes = wishes_of(request)
    modules = wishes.modules or DEFAULT_MODULES
    if isinstance(found, Shape):
        _note(directory, found.cells)
        modules = len(found) if wishes.method != "blocks" else BLOCK * len(found)
        if wishes.method != "blocks":
            _check_path(found, wishes)
    return {"name": found.name, "module": "cube", "modules": modules}


def preview(directory: Path) -> dict[str, Any]:
    """Writes ``report.json`` beside a preview's ``request.json``.

    Raises:
        InputError: When the input above it can't be used.
    """
    from planner.preparation import prepare

    request = json.loads((directory / "request.json").read_bytes())
    data = (directory.parent / "input").read_bytes()
    wishes = wishes_of(request)

    def prepared(wishes: Wishes) -> Preparation:
        return prepare(
            data,
            request["filename"],
            wishes,
            seed=request["seed"],
            time_limit_s=request["time_limit_s"],
        )

    try:
        made = prepared(wishes)
    except InputError as error:
        if error.code != "not-adjacent":
            raise
        made = prepared(replace(wishes, as_voxels=True))
        made = replace(made, notes=(READ_AS_VOXELS, *made.notes))
    aside = directory / f"report.{os.getpid()}"
    aside.write_text(json.dumps(made.report()))
    aside.rename(directory / "report.json")
    return {"kind": made.kind}


def _note(directory: Path, cells: NDArray[Any]) -> None:
    """Keeps cells for a drawing, so that nobody else has to read the upload for one."""
    if len(cells) <= LARGEST_DRAWING:
        (directory / "cells.json").write_text(json.dumps(cells.astype(int).tolist()))


def _check_path(shape: Shape, wishes: Wishes) -> None:
    """Refuses cells that have no path, for a reason that is quickly found."""
    from planner.feasibility import feasibility
    from planner.preparation import only_doubling, wished_repair

    state = feasibility(shape)
    if state.feasible is not False:
        return
    if wishes.repair and state.repairs:
        if wished_repair(shape, state, wishes) is not None:
            return
        raise InputError("no-path", only_doubling(shape, state.repairs[0]))
    why = " ".join(problem.detail for problem in state.problems)
    remedy = "the method 'blocks' makes 2×2×2 modules of each cell, which always has a path."
    if state.repairs:
        remedy = f"fold it with 'repair' ({state.repairs[0].detail}), or {remedy}"
    raise InputError(
        "no-path", f"got cells without a path through them. {why} Expected others; {remedy}"
    )
