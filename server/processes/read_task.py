"""Read task: checks and previews of uploads in a child; no other process parses them.

Solvers of paths are imported only when needed, because most uploads are paths.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.chain.built_in_modules import described_words
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.module import Module
from foldback.planner.chain.path import Path as CellPath
from foldback.planner.pipeline.request import FoldRequest, PreviewRequest
from foldback.planner.playback.unfolding import check_fits
from foldback.planner.readers import read
from foldback.planner.shapes.shape import Shape
from foldback.planner.shapes.solid import Solid
from foldback.planner.silhouettes.picture import Picture
from foldback.planner.silhouettes.word import Word
from foldback.planner.storage.file_names import START_PLAN
from foldback.planner.storage.files import write_sealed_json
from foldback.planner.twist_chains.cube_sequence import CubeSequence
from foldback.planner.twist_chains.figures import cube_names_of
from foldback.planner.twist_chains.folded_chains import cube_module
from foldback.server.processes.scratch import READ_CONTENT, request_in

MAX_DRAWN_CELLS: Final = 4000
"""Maximum number of cells, or modules, of which a fold's page shows an SVG drawing until the 3D
view is ready; larger ones have none, as it would make the page slow."""


def check(directory: Path) -> dict[str, Any]:
    """Check that a directory's input can become a fold; return the columns of its chain.

    The path search follows when the fold is computed; only certain failures are refused here.

    Raises:
        InputError: If the input cannot become a fold.
    """
    request = FoldRequest.from_json(request_in(directory))
    if request.smooth:
        return _smoothed(directory, request)
    data = (directory / "input").read_bytes()
    contents = read(data, filename=request.filename, as_voxels=request.as_voxels)
    begins = _begins(directory) if request.refold else None
    if isinstance(contents, CubeSequence):
        module, modules = cube_module(contents), len(contents)  # solved when it is folded
        if begins is not None:
            check_fits(begins, module, modules)
        return _described(next(iter(cube_names_of(contents)), "Snake cube"), module, modules)
    if isinstance(contents, CellPath) and request.kind.follows_paths:
        contents = Chain.from_path(contents)
    if isinstance(contents, Chain):
        if contents.module.fills_cell:
            _note(directory, np.rint(contents.folded_poses.positions))
        if begins is not None:
            check_fits(begins, contents.module, len(contents))
        if request.world == "table":
            from foldback.planner.pipeline.prepare import check_for_table

            check_for_table(contents)
        return _described(contents.name, contents.module, len(contents))
    from foldback.planner.pathfinding.path_options import DEFAULT_MODULES
    from foldback.planner.pipeline.prepare import filling_of, prepare_subject

    options = request.path_options()
    options.check()
    modules = options.modules or DEFAULT_MODULES
    if isinstance(contents, Word | Picture):
        cells = prepare_subject(contents, options, searching=False).shape
        assert cells is not None  # a drawing has at least one cell, or is refused
        _note(directory, cells.cells)
        modules = filling_of(options).modules_of(cells, options, of_solid=True)
        if begins is not None and options.method != "exact":
            check_fits(begins, options.kind, modules)
        return _described(cells.name, options.kind, modules)
    if isinstance(contents, Shape | CellPath):
        shape = Shape.from_cells(contents.cells, name=contents.name, pitch_m=contents.pitch_m)
        filling = filling_of(options)
        _note(directory, shape.cells)
        filling.check(shape, options)
        modules = filling.modules_of(shape, options, of_solid=False)
        if begins is not None and not options.repair and options.method != "blocks":
            check_fits(begins, options.kind, modules)
    return _described(contents.name, options.kind, modules)


def _begins(directory: Path) -> Chain:
    """Return the initial chain of a refold.

    Raises:
        InputError: If the plan does not lead from a straight to a folded chain.
    """
    from foldback.planner.plan.plan import Plan

    return Plan.load(directory / START_PLAN).unfolding().chain


def _smoothed(directory: Path, request: FoldRequest) -> dict[str, Any]:
    """Return the description of the chain of a plan to be smoothed."""
    from foldback.planner.plan.plan import Plan
    from foldback.planner.smoothing.smoothed_plan import check_smoothable
    from foldback.planner.storage.file_names import RECORDED_PLAN

    request.check()
    plan = Plan.load(directory / RECORDED_PLAN)
    check_smoothable(plan)
    return _described(plan.chain.name, plan.chain.module, len(plan.chain))


def _described(name: str, module: Module, modules: int) -> dict[str, Any]:
    """Return the columns of a fold's row that describe its chain."""
    return {
        "name": name,
        "module": module.name,
        "module_words": described_words(module),
        "modules": modules,
    }


def preview(directory: Path) -> dict[str, Any]:
    """Write ``report.json`` to the directory of a preview's ``request.json``.

    Raises:
        InputError: If the input in the parent directory is invalid.
    """
    from foldback.planner.pipeline.prepare import prepare_subject, read_in_any_order
    from foldback.planner.plan.prepared_chains import key_of

    about = request_in(directory)
    request = PreviewRequest.from_json(about)
    request.check()
    data = (directory.parent / "input").read_bytes()
    (directory / READ_CONTENT).unlink(missing_ok=True)
    options = request.path_options()
    contents, read_options, notes = read_in_any_order(data, about["filename"], options)
    # What is said if the time runs out depends on what took it.
    triangles = len(contents) if isinstance(contents, Solid) else 0
    (directory / READ_CONTENT).write_text(json.dumps({"triangles": triangles}))
    preparation = prepare_subject(
        contents,
        read_options,
        seed=request.seed,
        time_limit_s=about["time_limit_s"],
        searching=request.path,
        offering=True,
        quick=request.quick,
    )
    preparation = replace(preparation, notes=(*notes, *preparation.notes))
    if (
        preparation.options == options and preparation.repeatable
    ):  # only then a fold would get the same result
        key = key_of(data, about["filename"], options, request.seed)
        preparation.prepared().save(directory, key)
    write_sealed_json(directory / "report.json", preparation.report())
    return {"kind": preparation.kind}


def offers(directory: Path, cancelled: Callable[[], bool]) -> dict[str, Any]:
    """Write ``offers.json``: changed versions of a shape without a path for a table.

    Args:
        directory: Directory of the preview's options.
        cancelled: Returns True once the client has disconnected; the search then ends.

    Raises:
        InputError: If the input is invalid.
    """
    from foldback.planner.table_paths.offers import table_offers

    about = request_in(directory)
    request = PreviewRequest.from_json(about)
    request.check()
    data = (directory.parent / "input").read_bytes()
    contents = read(data, filename=about["filename"], as_voxels=request.as_voxels)
    offered: list[dict[str, Any]] = []
    if isinstance(contents, Shape | Solid):
        search = table_offers(
            contents,
            request.path_options(),
            seed=request.seed,
            time_limit_s=2.0 * about["time_limit_s"],
            cancelled=cancelled,
        )
        for offer in search:  # stored one by one, because the search may be killed
            offered.append(offer.report())
            write_sealed_json(directory / "offers.json", {"offers": offered})
    if not offered and not cancelled():
        write_sealed_json(directory / "offers.json", {"offers": []})
    return {"offers": len(offered)}


def _note(directory: Path, cells: NDArray[Any]) -> None:
    """Store cells for a drawing, so that no other process has to read the upload for it."""
    if len(cells) <= MAX_DRAWN_CELLS:
        (directory / "cells.json").write_text(json.dumps(cells.astype(int).tolist()))
