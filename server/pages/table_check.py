"""Table check: quick tests that rule out a path for a table through the cells of a fold."""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path

import numpy as np

from foldback.planner.chain.chain_attributes import chain_from_attributes
from foldback.planner.errors import UNREADABLE, PlannerError


@lru_cache(maxsize=256)
def ruled_out_on_table(chain: Path) -> bool:
    """Return True if a chain's cells have no path for a table on any side, by quick tests alone.

    Args:
        chain: Chain file of the fold. One that cannot be read counts as ruled out.
    """
    # Imported late, because these modules load SciPy.
    from foldback.planner.table_paths.base_sides import sides_of
    from foldback.planner.table_paths.no_table_path_proofs import ruled_out

    try:
        positions = chain_from_attributes(json.loads(chain.read_bytes())).folded_poses.positions
    except (PlannerError, *UNREADABLE):
        return True
    sides = list(sides_of(np.rint(positions).astype(np.int64)))
    reasons = [ruled_out(side) for side in sides]
    return all(reason is not None and not reason.may_fall for reason in reasons)
