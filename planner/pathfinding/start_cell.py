"""Start cell: the requested first cell of a chain."""

from __future__ import annotations

import re
from typing import Final

import numpy as np

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.path import Path
from foldback.planner.errors import InputError
from foldback.planner.pathfinding import Cell
from foldback.planner.pathfinding.lattice import index_of, tuples
from foldback.planner.pathfinding.path_reasons import PathCode, PathReason

CELL_TEXT: Final = r"\s*-?\d{1,6}\s*,\s*-?\d{1,6}\s*,\s*-?\d{1,6}\s*"


def parse_cell(text: str) -> Cell:
    """Parse a cell of the form "x,y,z".

    Raises:
        InputError: ``bad-start`` for anything else.
    """
    if not re.fullmatch(CELL_TEXT, text, re.ASCII):
        raise InputError(
            "bad-start",
            f"got the start {text[:40]!r}, expected a cell as x,y,z, for example 3,0,12.",
        )
    x, y, z = (int(word) for word in text.split(","))
    return x, y, z


def starting_at(chain: Chain, start: Cell | None) -> tuple[Chain, tuple[PathReason, ...]]:
    """Return a chain that begins in a cell, if that leaves its links as they are.

    It can be run through from either end, and one whose ends touch is a ring that can be cut
    anywhere.

    Args:
        chain: The chain.
        start: The cell, None for any.

    Returns:
        The chain that begins there and no reason, or the unchanged chain and the reason.

    Raises:
        InputError: ``not-a-cell``: the chain has no module there.
    """
    if start is None:
        return chain, ()
    if not chain.module.follows_paths:
        return chain, (PathReason.of(PathCode.GIVEN_MODULES),)
    cells = np.rint(chain.folded_poses.positions).astype(np.int64)
    at = index_of(cells, start)
    if not at:
        return chain, ()
    if at == len(cells) - 1:
        turned = cells[::-1]
    elif int(np.abs(cells[0] - cells[-1]).sum()) == 1:
        turned = np.roll(cells, -at, axis=0)
    else:
        ends = tuples(cells[[0, -1]])
        return chain, (PathReason.of(PathCode.GIVEN_CELLS, ends=ends, cell=start),)
    path = Path.from_cells(turned, name=chain.name, pitch_m=chain.pitch_m)
    return Chain.from_path(path, module=chain.module), ()
