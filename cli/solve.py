"""``foldback solve``: solve a snake cube, or find the pieces of one that fills a solid."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Annotated, Any, Final, TypedDict, cast

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from foldback.cli.exit_statuses import NOT_ACHIEVED
from foldback.cli.inputs import read_input, refuse
from foldback.cli.options import AsJson
from foldback.cli.typed_codes import typed_sequence
from foldback.planner.arrays import Ints
from foldback.planner.chain.path import Path as CellPath
from foldback.planner.errors import InputError
from foldback.planner.pathfinding.snake_cubes import (
    MAX_PIECES,
    SnakeCubeSearch,
    box_cells,
    boxes_of,
    default_max_steps,
    find_common_sequence,
    find_sequence,
    fold_sequence,
)
from foldback.planner.plan.shape_writers import write_chain
from foldback.planner.readers import read
from foldback.planner.shapes.shape import Shape
from foldback.planner.storage.files import write_whole
from foldback.planner.twist_chains.cube_sequence import CubeSequence
from foldback.planner.twist_chains.folded_chains import cube_chain

BOX: Final = re.compile(r"(\d{1,4})x(\d{1,4})x(\d{1,4})")
"""Matches the sides of a box, in cells."""
MAX_LISTED_SOLUTIONS: Final = 1000
"""Maximum number of solutions that ``--all`` lists."""


class _Limits(TypedDict):
    """Limits and seed of a search."""

    max_solutions: int
    max_steps: int
    seed: int


def solve(
    *,
    pieces: Annotated[
        str | None,
        typer.Argument(
            metavar="PIECES",
            help="Pieces of a snake cube: a digit for each (1 corner, 0 straight or end), a list "
            "of runs, another notation with its name before it (legs: 2,1,2), or the name of a "
            "known one. Without them, a sequence of pieces is searched.",
        ),
    ] = None,
    into: Annotated[
        list[str] | None,
        typer.Option(
            metavar="SOLID",
            help="Solid to fill: a box such as 3x3x3, a file with voxels or cells, or the name of "
            "an example. Default: the box of all pieces that is closest to a cube. Given twice, "
            "one sequence of pieces for both is searched.",
        ),
    ] = None,
    corners: Annotated[
        int | None, typer.Option(help="Number of corners of the sequence that is searched.")
    ] = None,
    every: Annotated[
        bool, typer.Option("--all", help="Find all solutions, up to symmetries of the solid.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(help="Output file for the first solution, as a chain that 'fold' takes."),
    ] = None,
    max_steps: Annotated[
        int | None,
        typer.Option(
            help="Attempts to place a piece after which the search ends. Default: half a minute."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the order of the search.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Solve a snake cube. Exits 0 with a solution, 3 when there is none, 2 for bad input."""
    try:
        sequence = None if pieces is None else typed_sequence(pieces)
        solids = _solids(into or [], sequence)
        limits: _Limits = {
            "max_solutions": MAX_LISTED_SOLUTIONS if every else 1,
            "max_steps": default_max_steps(len(solids[0])) if max_steps is None else max_steps,
            "seed": seed,
        }
        search = _search(sequence, solids, corners, limits)
        if out is not None and len(search.paths):
            write_whole(out, write_chain(cube_chain(search.paths[0, 0])))
    except InputError as error:
        refuse(error, as_json)
    except OSError as error:
        problem = f"cannot be written ({error.strerror})."
        refuse(InputError("no-file", problem, where=str(out)), as_json)
    if as_json:
        print(json.dumps(_report(search)), flush=True)
    else:
        _show(search, out)
    if not len(search.paths):
        raise typer.Exit(NOT_ACHIEVED)


def _solids(names: list[str], sequence: CubeSequence | None) -> tuple[Ints, ...]:
    """Return the cells of the solids.

    Raises:
        InputError: ``no-input`` for a wrong number of solids; others if one cannot be read.
    """
    if sequence is not None and not names:
        return (box_cells(boxes_of(len(sequence))[0]),)
    allowed = 1 if sequence is not None else 2
    if not 1 <= len(names) <= allowed:
        expected = "one solid for given pieces" if sequence is not None else "one solid or two"
        raise InputError("no-input", f"got {len(names)} solids (--into), expected {expected}.")
    return tuple(_solid(name) for name in names)


def _solid(name: str) -> Ints:
    match = BOX.fullmatch(name.strip().lower().replace("×", "x"))
    if match is not None:
        sides = cast("tuple[int, int, int]", tuple(map(int, match.groups())))
        if not 2 <= np.prod(sides) <= MAX_PIECES:
            raise InputError(
                "too-many-cells", f"got the box {name}, expected 2 to {MAX_PIECES} cells."
            )
        return box_cells(sides)
    data, filename = read_input(name)
    contents = read(data, filename=filename, as_voxels=True, max_cells=MAX_PIECES)
    if not isinstance(contents, Shape | CellPath):
        raise InputError(
            "wrong-kind",
            "expected a box such as 3x3x3, or a file with voxels or cells.",
            where=name,
        )
    return np.asarray(contents.cells, dtype=np.int64)


def _search(
    sequence: CubeSequence | None, solids: tuple[Ints, ...], corners: int | None, limits: _Limits
) -> SnakeCubeSearch:
    """Run the search that fits what is given.

    Raises:
        InputError: If pieces, corners and cells do not fit each other.
    """
    if sequence is not None:
        if corners not in (None, sequence.corner_count):
            raise InputError(
                "wrong-count",
                f"got {corners} corners (--corners), but the given pieces have "
                f"{sequence.corner_count}; leave out one of the two.",
            )
        return fold_sequence(sequence, solids[0], **limits)
    if len(solids) == 2:
        return find_common_sequence((solids[0], solids[1]), corners, **limits)
    return find_sequence(solids[0], corners, **limits)


def _status(search: SnakeCubeSearch) -> str:
    if len(search.paths):
        return "solved"
    return "none" if search.is_complete else "undecided"


def _report(search: SnakeCubeSearch) -> dict[str, Any]:
    """Return the result as plain JSON values."""
    sequences = [sequence.text() for sequence in search.sequences]
    return {
        "status": _status(search),
        "is_complete": search.is_complete,
        "steps": search.steps,
        "solutions": [
            {"sequence": sequence, "cells": paths.tolist()}
            for sequence, paths in zip(sequences, search.paths, strict=True)
        ],
    }


def _show(search: SnakeCubeSearch, out: Path | None) -> None:
    """Print the first solution, and how many there are."""
    console = Console(soft_wrap=True, highlight=False)
    if not len(search.paths):
        text = (
            "There is no solution: all ways were tried."
            if search.is_complete
            else "No solution was found, but not all ways were tried; allow more steps "
            "(--max-steps), or use another seed (--seed)."
        )
        Console(stderr=True, soft_wrap=True, highlight=False).print(text, markup=False)
        return
    sequence = search.sequences[0]
    grid = Table(box=None, show_header=False, pad_edge=False)
    grid.add_row("Pieces", f"{len(sequence)}, of which {sequence.corner_count} corners")
    grid.add_row("Sequence", sequence.text())
    grid.add_row("Runs", sequence.text("runs"))
    for path in search.paths[0]:
        grid.add_row("Solution", " ".join(_moves(path)))
    count = str(len(search.paths))
    grid.add_row("Solutions", f"{count} in all" if search.is_complete else f"at least {count}")
    grid.add_row("Steps of the search", str(search.steps))
    if out is not None:
        grid.add_row("Written to", str(out))
    console.print(grid)


def _moves(path: Ints) -> list[str]:
    """Return straight runs of a path as numbers of steps along signed axes, such as ``+2x``."""
    runs: list[tuple[int, int, int]] = []
    for step in np.diff(path, axis=0).tolist():
        axis = next(k for k in range(3) if step[k])
        sign = step[axis]
        if runs and runs[-1][:2] == (axis, sign):
            runs[-1] = (axis, sign, runs[-1][2] + 1)
        else:
            runs.append((axis, sign, 1))
    return [f"{'+' if sign > 0 else '-'}{length}{'xyz'[axis]}" for axis, sign, length in runs]
