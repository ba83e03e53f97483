"""``foldback shape``: find a path through a solid or voxels, without folding it."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from foldback.cli.exit_statuses import NOT_ACHIEVED
from foldback.cli.inputs import read_input, refuse
from foldback.cli.options import PATH_OPTIONS, AsJson, takes
from foldback.planner.chain.path import Path as CellPath
from foldback.planner.errors import InputError
from foldback.planner.pathfinding.path_options import table_warning
from foldback.planner.pipeline.prepare import Preparation, prepare_in_any_order
from foldback.planner.pipeline.request import PATH_SEED_MODULUS, FoldRequest
from foldback.planner.plan.shape_writers import write_chain, write_path
from foldback.planner.shapes.shape import MAX_CELLS
from foldback.planner.storage.files import write_whole
from foldback.words.likeness import likeness_words, reach_words

if TYPE_CHECKING:
    from foldback.planner.table_paths.offers import Offer

KNOT_WORDS = {
    "unknot": "none",
    "knotted": "yes; the chain can never be straightened",
    "undecided": "unknown",
}
"""Words for the verdict on a knot."""


@takes(*PATH_OPTIONS)
def shape(
    *,
    source: Annotated[
        str,
        typer.Argument(
            metavar="INPUT", help="File with a mesh, voxels or cells; or name of an example."
        ),
    ],
    out: Annotated[Path, typer.Option(help="Output file for the path or the chain.")],
    request: FoldRequest,
    as_json: AsJson = False,
) -> None:
    """Find a path through a shape. Exits 0 with a path, 3 when there is none, 2 for bad input."""
    try:
        data, filename = read_input(source)
        prepared = prepare_in_any_order(
            data, filename, request.path_options(), seed=request.seed % PATH_SEED_MODULUS
        )
        if prepared.not_started:
            prepared.chain  # noqa: B018
        if prepared.chains:
            write_whole(out, path_file(prepared))
        offers = [] if prepared.chains else offers_for(data, filename, request)
    except InputError as error:
        refuse(error, as_json)
    except OSError as error:
        problem = f"cannot be written ({error.strerror})."
        refuse(InputError("no-file", problem, where=str(out)), as_json)
    report = {
        **prepared.report(full=False),
        "mesh": None,
        "cells": None,
        "offers": [offer.report() for offer in offers],
    }
    if as_json:
        print(json.dumps({"status": "found" if prepared.chains else "none", **report}), flush=True)
    else:
        show(report, out)
    if prepared.chains and (warning := table_warning(len(prepared.chain), request.world)):
        print(warning, file=sys.stderr)
    if not prepared.chains:
        if not as_json:
            print_no_path(prepared, offers)
        raise typer.Exit(NOT_ACHIEVED)


def print_no_path(prepared: Preparation, offers: Sequence[Offer]) -> None:
    """Print the reason why there is no path, and the variants that have one, as an error."""
    text = "\n".join([no_path(prepared), *map(offer_words, offers)])
    Console(stderr=True, soft_wrap=True, highlight=False).print(text, markup=False)


def offers_for(data: bytes, filename: str, request: FoldRequest) -> list[Offer]:
    """Return versions of a shape that have a path for a table; none for another world."""
    from foldback.planner.readers import read
    from foldback.planner.shapes.shape import Shape
    from foldback.planner.shapes.solid import Solid
    from foldback.planner.table_paths.offers import table_offers

    options = request.path_options()
    if options.world != "table":
        return []
    contents = read(data, filename=filename, as_voxels=options.as_voxels)
    if not isinstance(contents, Shape | Solid):
        return []
    return list(table_offers(contents, options, seed=request.seed % PATH_SEED_MODULUS))


def offer_words(offer: Offer) -> str:
    """Return an offer as a line: the number of modules and the options to use."""
    options = [
        f"--{name}" if value is True else f"--{name} {value}"
        for name, value in offer.change.items()
        if value not in (False, "auto")
    ]
    return f"A similar shape has a path: {' '.join(options)} ({offer.modules} modules)"


def path_file(prepared: Preparation) -> bytes:
    """Return the best path as foldback-path/1; foldback-chain/1 if its modules follow none."""
    if not prepared.chain.module.follows_paths:
        return write_chain(prepared.chain)
    return write_path(
        CellPath.from_cells(prepared.cells, name=prepared.name, pitch_m=prepared.chain.pitch_m)
    )


def no_path(prepared: Preparation) -> str:
    """Return the reason why there is no path, in words."""
    try:
        prepared.chain  # noqa: B018
    except InputError as error:
        return str(error)
    return ""


def show(report: dict[str, Any], out: Path) -> None:
    """Print the result of reading the input."""
    grid = Table(box=None, show_header=False, pad_edge=False)
    grid.add_row("Input", report["kind"])
    grid.add_row("Modules", str(report["modules"]))
    if (likeness_text := likeness_words(report["likeness"])) is not None:
        grid.add_row("Likeness", likeness_text)
        near = [str(n) for n in (report["below"], report["above"]) if n is not None]
        if near:
            grid.add_row("Nearest possible numbers of modules", ", ".join(near))
    if report["reach"]:
        grid.add_row("Modules needed", reach_words(report["reach"], MAX_CELLS))
    if report["method"]:
        grid.add_row("Path method", f"{report['method']}, {report['candidates']} candidates")
    if report["knot"] is not None:
        grid.add_row("Knot in the path", KNOT_WORDS[report["knot"]["verdict"]])
    if report["repaired"]:
        grid.add_row("Repaired", report["repaired"])
    for note in report["notes"]:
        grid.add_row("Note", note)
    if report["has_path"]:
        grid.add_row("Written to", str(out))
    Console().print(grid)
