"""Mending for a table: the few cells to add to a shape so that a path for a table may exist."""

from __future__ import annotations

import numpy as np

from foldback.planner.arrays import Ints
from foldback.planner.pathfinding import Cell
from foldback.planner.pathfinding.feasibility import named_cells
from foldback.planner.pathfinding.lattice import colours, parts
from foldback.planner.pathfinding.no_path_proofs import obstacles
from foldback.planner.pathfinding.path_options import MAX_TABLE_MODULES
from foldback.planner.shapes.shape import Shape
from foldback.planner.table_paths.table_paths import paths_or_reasons


def cells_to_add(cells: Ints, seed: int = 0) -> list[Cell]:
    """Return cells whose addition gives a shape a path for a table, as it stands.

    First the obstacles of the shape and of its layers are removed; then one or two more cells are
    tried where that is not enough. The same cells and seed give the same result.

    Args:
        cells: (n, 3) distinct cells.
        seed: Seed of the path searches.

    Returns:
        No cells if none were found.
    """
    low = np.array([0, 0, cells[:, 2].min()])
    standing = cells - low
    added = _obstacles_removed(standing)
    if added is None:
        return []
    now = {(int(x), int(y), int(z)) for x, y, z in standing} | set(added)
    tries = [added] if added else []
    tries += [[*added, cell] for cell in _near(now)[:6]]  # each takes about 1 s
    for added_cells in tries:
        paths, _ = paths_or_reasons(
            _with(standing, added_cells), seed=seed, max_paths=1, turned=False
        )
        if paths:
            return [(x, y, z + int(low[2])) for x, y, z in added_cells]
    return []


def with_cells(shape: Shape, added: list[Cell]) -> Shape:
    """Return a shape with cells added."""
    return Shape.from_cells(_with(shape.cells, added), name=shape.name, pitch_m=shape.pitch_m)


def added_words(added: list[Cell]) -> str:
    """Return what a repair did, to follow a colon."""
    return f"added {named_cells(added)}."


def nearest_words(cells: Ints, seed: int = 0) -> str:
    """Return a sentence on the nearest cells with a path for a table; empty if none were found.

    Shapes of more than ``MAX_TABLE_MODULES`` cells, which rarely fold on a table, are not searched.

    Args:
        cells: (n, 3) distinct cells.
        seed: Seed of the path searches.
    """
    added = cells_to_add(cells, seed) if len(cells) < MAX_TABLE_MODULES else []
    if not added:
        return ""
    return f" Possible repair: add {named_cells(added)}, for {len(cells) + len(added)} modules."


def _with(cells: Ints, added: list[Cell]) -> Ints:
    return np.concatenate([cells, np.array(added, dtype=np.int64).reshape(-1, 3)])


def _obstacles_removed(cells: Ints) -> list[Cell] | None:
    """Return the cells to add until nothing is known against a path; None if too many are needed.

    Each is added where it helps most: on the floor or on another cell, never above an empty cell.
    """
    now = {(int(x), int(y), int(z)) for x, y, z in cells}
    added: list[Cell] = []
    max_added = min(24, max(2, round(0.1 * len(cells))))
    trouble = _trouble(now)
    while trouble and len(added) < max_added:
        options = [(_trouble(now | {cell}), rank, cell) for rank, cell in enumerate(_near(now))]
        best = min(options, default=None)
        if best is None or best[0] >= trouble:
            return None
        trouble = best[0]
        now.add(best[2])
        added.append(best[2])
    return None if trouble else added


def _trouble(cells: set[Cell]) -> int:
    """Return by how much a shape and its layers miss a path; 0 where no obstacle is known."""
    array = np.array(sorted(cells), dtype=np.int64)
    return _amount(array) + sum(
        _amount(array[array[:, 2] == height]) for height in np.unique(array[:, 2])
    )


def _amount(cells: Ints) -> int:
    count = parts(cells)[0]
    if count > 1:
        return 1000 * (count - 1)  # worse than any number of cells too many of a colour
    return sum(problem.amount for problem in obstacles(cells)) if len(cells) > 2 else 0


def _near(now: set[Cell]) -> list[Cell]:
    """Return the free cells beside a shape that may help, those with most neighbours first."""
    array = np.array(sorted(now), dtype=np.int64)
    colour_of_height: dict[int, int | None] = {}
    for height in np.unique(array[:, 2]).tolist():
        layer = array[array[:, 2] == height]
        excess = int((1 - 2 * colours(layer)).sum())
        if _amount(layer):
            colour_of_height[height] = None if abs(excess) < 2 else (1 if excess > 0 else 0)
    excess_of_all = int((1 - 2 * colours(array)).sum())
    if not colour_of_height:
        colour = None if abs(excess_of_all) < 2 else (1 if excess_of_all > 0 else 0)
        colour_of_height = dict.fromkeys(np.unique(array[:, 2]).tolist(), colour)
    neighbour_counts: dict[Cell, int] = {}
    for x, y, z in now:
        if z not in colour_of_height:
            continue
        for i, j in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            cell = x + i, y + j, z
            borne = z == 0 or (cell[0], cell[1], z - 1) in now
            if cell in now or not borne:
                continue
            neighbour_counts[cell] = neighbour_counts.get(cell, 0) + 1
    shade = {cell: int(colours(np.array([cell], dtype=np.int64))[0]) for cell in neighbour_counts}
    fitting = [
        c
        for c in neighbour_counts
        if colour_of_height[c[2]] is None or shade[c] == colour_of_height[c[2]]
    ]
    return sorted(fitting, key=lambda c: (-neighbour_counts[c], c))[:16]
