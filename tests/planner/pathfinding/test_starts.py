from __future__ import annotations

import numpy as np
import pytest

from planner.chain.chain import Chain
from planner.chain.path import Path
from planner.errors import InputError
from planner.pathfinding.starts import cell_of, started

RING = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0], [1, 1, 0], [0, 1, 0]]
HOOK = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 1, 1]]


def cells_of(chain: Chain) -> list[list[int]]:
    return np.rint(chain.folded_poses.positions).astype(int).tolist()


def test_ring_is_cut_anywhere() -> None:
    for x, y, z in RING:
        chain, why = started(Chain.from_path(Path.from_cells(RING)), (x, y, z))
        found = cells_of(chain)
        assert why == ""
        assert found[0] == [x, y, z]
        assert sorted(found) == sorted(RING)


def test_open_path_begins_at_either_end() -> None:
    chain = Chain.from_path(Path.from_cells(HOOK))
    assert started(chain, None) == (chain, "")
    assert cells_of(started(chain, (0, 0, 0))[0]) == HOOK
    assert cells_of(started(chain, (0, 1, 1))[0]) == HOOK[::-1]
    kept, why = started(chain, (1, 1, 0))
    assert kept is chain
    assert "(1, 1, 0)" in why
    assert "voxels" in why
    with pytest.raises(InputError) as refused:
        started(chain, (5, 5, 5))
    assert refused.value.code == "not-a-cell"


def test_cells_are_read_from_text() -> None:
    assert cell_of(" 3, -1,12") == (3, -1, 12)
    for text in ("", "1,2", "1,2,3,4", "a,b,c", "1.5,0,0", "1,2,99999999"):
        with pytest.raises(InputError) as refused:
            cell_of(text)
        assert refused.value.code == "bad-start"
