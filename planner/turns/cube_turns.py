"""Cube turns: the clear quarter turns of chains of cubes, from an exact table of swept cells."""

from __future__ import annotations

from typing import Final

import numpy as np

from foldback.planner.chain.chain import Chain
from foldback.planner.core import (
    BORDER,
    clear_cube_turns,
    count_cube_contacts,
    test_cube_turns,
    without_cube_overlaps,
)
from foldback.planner.core.structures import CubeScratch, SweptCells
from foldback.planner.turns.turning import Turning, TurnKernels

MIN_TABLE_ENTRIES: Final = 2**16
"""Number of entries for which a table of swept cells has room at first; it doubles when full."""


def _double_table(table: SweptCells) -> SweptCells:
    return table._replace(
        cells=np.concatenate([table.cells, np.empty_like(table.cells)]),
        gaps=np.concatenate([table.gaps, np.empty_like(table.gaps)]),
    )


KERNELS: Final = TurnKernels(
    count_contacts=count_cube_contacts,
    test_turns=test_cube_turns,
    clear_turns=clear_cube_turns,
    without_overlaps=without_cube_overlaps,
    double_table=_double_table,
)
"""Kernels of chains of cubes."""


def cube_turning(chain: Chain, module_size: float) -> Turning:
    """Return the quarter turns of a chain of cubes on the lattice.

    A turn is clear if no two modules that are not exempt come nearer than ``room`` to each other on
    the way. Cubes that turn about a lattice axis stay in their layers, where the distance of two
    squares is known in closed form (``planner/core/cube_turns.cpp``).
    """
    modules = len(chain)
    radius = modules // 2 + 2  # the shorter part of the chain reaches no farther
    table = SweptCells(
        start=np.full((radius, radius), -1, np.int32),
        stop=np.zeros((radius, radius), np.int32),
        cells=np.empty((MIN_TABLE_ENTRIES, 2), np.int16),
        gaps=np.empty(MIN_TABLE_ENTRIES, np.float32),
        used=np.zeros(1, np.int64),
        half=0.5 * module_size,
        reach=1.0 - module_size,
    )
    scratch = CubeScratch(
        cells=np.zeros((modules, 3), np.int64),
        axes=np.zeros((modules, 3, 3), np.int64),
        # The extents of a chain's box add up to at most its length and 2 for the corners.
        grid=np.zeros(((modules + 4) // 3 + 2 * BORDER) ** 3, np.int16),
        contacts=np.zeros(modules, np.int64),
        nearest=np.zeros(modules + 2 * BORDER),
        farthest=np.zeros(modules + 2 * BORDER),
    )
    return Turning(chain, module_size, width=4, kernels=KERNELS, table=table, scratch=scratch)
