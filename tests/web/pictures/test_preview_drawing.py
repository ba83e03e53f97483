import json
from typing import Any

import numpy as np

from planner.pathfinding.path_options import PathOptions
from planner.pipeline.prepare import prepare
from web.pictures.isometric import isometric_svg
from web.pictures.preview_drawing import MAX_DRAWN_CUBES, preview_svg

CROSS = [[1, 0, 0], [0, 1, 0], [1, 1, 0], [2, 1, 0], [1, 2, 0]]


def report(cells: list[list[int]], module: str = "cube") -> dict[str, Any]:
    data = json.dumps({"format": "foldback-voxels/1", "cells": cells}).encode()
    return prepare(data, None, PathOptions(module=module)).report()


def test_cells_are_drawn_in_the_direction_of_the_3d_view() -> None:
    # Two on the floor along x, one on the first: the 3D view looks from +x and -y.
    drawn = preview_svg({"module": "cube", "cells": [[0, 0, 0], [1, 0, 0], [0, 0, 1]]})
    assert drawn == isometric_svg([[0, 0, 0], [0, 1, 0], [0, 0, 1]], size=480)


def test_preview_svg_without_a_path_colours_odd_and_added_cells() -> None:
    found = report(CROSS)
    assert not found["has_path"]
    odd = [cell for problem in found["feasibility"]["problems"] for cell in problem["cells"]]
    drawn = preview_svg(found, [[5, 0, 0]])
    turned = np.array(found["cells"]) @ [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]
    marks = [(-y, x, z) for x, y, z in odd]
    assert marks and drawn == isometric_svg(turned, size=480, odd=marks, added=[(0, 5, 0)])
    assert drawn and "iso-odd-top" in drawn


def test_tetrahedra_are_drawn_in_their_poses() -> None:
    found = report(np.argwhere(np.ones((2, 2, 2))).tolist(), module="tetrahedron")
    drawn = preview_svg(found) or ""
    assert drawn.startswith("<svg") and "iso-top" not in drawn


def test_preview_that_would_take_long_is_not_drawn() -> None:
    cells = np.argwhere(np.ones((1, 1, MAX_DRAWN_CUBES + 1))).tolist()
    assert preview_svg({"module": "cube", "cells": cells}) is None
    assert preview_svg({"module": "cube", "cells": []}) is None
