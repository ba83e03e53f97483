"""Tetrahedron turns: the clear quarter turns of chains of tetrahedra, in the honeycomb."""

from __future__ import annotations

from typing import Final

import numpy as np

from foldback.planner.chain.chain import Chain
from foldback.planner.core import (
    clear_tetrahedron_turns,
    count_tetrahedron_contacts,
    test_tetrahedron_turns,
    without_tetrahedron_overlaps,
)
from foldback.planner.core.structures import TetrahedronScratch, TurningGaps
from foldback.planner.turns.turning import Turning, TurnKernels, gap_between_cells

MIN_TABLE_ENTRIES: Final = 2**17
"""Number of slots of the table of turning gaps at first; it doubles when it is half full. Chains of
192 tetrahedra fill up to 35 000."""


def _double_table(table: TurningGaps) -> TurningGaps:
    slots = 2 * len(table.keys)
    return table._replace(
        keys=np.full(slots, -1, np.int64),
        gaps=np.zeros(slots, np.float32),
        used=np.zeros(1, np.int64),
    )


KERNELS: Final = TurnKernels(
    count_contacts=count_tetrahedron_contacts,
    test_turns=test_tetrahedron_turns,
    clear_turns=clear_tetrahedron_turns,
    without_overlaps=without_tetrahedron_overlaps,
    double_table=_double_table,
)
"""Kernels of chains of tetrahedra."""


def tetrahedron_turning(chain: Chain, module_size: float) -> Turning:
    """Return the quarter turns of a chain of tetrahedra in the honeycomb.

    A turn is clear if no two modules that are not linked come nearer than ``room`` to each other on
    the way. Two linked ones keep the gap between two cells while their hinge turns.
    """
    modules = len(chain)
    table = TurningGaps(
        keys=np.full(MIN_TABLE_ENTRIES, -1, np.int64),
        gaps=np.zeros(MIN_TABLE_ENTRIES, np.float32),
        used=np.zeros(1, np.int64),
        hull=chain.module.hull,
        size=float(module_size),
        reach=gap_between_cells(chain, module_size),
    )
    slots = 4 << modules.bit_length()
    scratch = TetrahedronScratch(
        nodes=np.zeros((modules + 1, 3), np.int64),
        axes=np.zeros((modules, 3), np.int64),
        projected=np.zeros((modules, 3), np.int64),
        cells=np.full(slots, -1, np.int64),
        modules=np.zeros(slots, np.int32),
        contacts=np.zeros(modules, np.int64),
    )
    return Turning(chain, module_size, width=1, kernels=KERNELS, table=table, scratch=scratch)
