import json
from typing import Any

import numpy as np

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.path import Path
from foldback.planner.pathfinding.path_options import PathOptions
from foldback.planner.pipeline.prepare import prepare
from foldback.web.pictures.isometric import isometric_svg
from foldback.web.pictures.isometric_modules import chain_svg
from foldback.web.pictures.preview_drawing import MAX_DRAWN_CUBES, preview_svg

CROSS = [[1, 0, 0], [0, 1, 0], [1, 1, 0], [2, 1, 0], [1, 2, 0]]


def report(cells: list[list[int]], module: str = "cube") -> dict[str, Any]:
    data = json.dumps({"format": "foldback-voxels/1", "cells": cells}).encode()
    return prepare(data, None, PathOptions(module=module)).report()


def test_preview_of_a_path_is_the_drawing_of_its_fold() -> None:
    cells = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 1], [0, 1, 1]]
    data = json.dumps({"format": "foldback-path/1", "cells": cells}).encode()
    computed_report = prepare(data, None, PathOptions()).report()
    chain = Chain.from_path(Path.from_cells(cells))
    assert preview_svg(computed_report) == chain_svg(chain, size=480)


def test_preview_svg_without_a_path_colours_odd_and_added_cells() -> None:
    computed_report = report(CROSS)
    assert not computed_report["has_path"]
    odd = [
        cell for problem in computed_report["feasibility"]["problems"] for cell in problem["cells"]
    ]
    drawn = preview_svg(computed_report, [[5, 0, 0]])
    assert odd and drawn == isometric_svg(
        computed_report["cells"], size=480, odd=odd, added=[[5, 0, 0]]
    )
    assert drawn and "iso-odd-top" in drawn


def test_tetrahedra_are_drawn_in_their_poses() -> None:
    computed_report = report(np.argwhere(np.ones((2, 2, 2))).tolist(), module="tetrahedron")
    drawn = preview_svg(computed_report) or ""
    assert drawn.startswith("<svg") and "iso-top" not in drawn


def test_preview_that_would_take_long_is_not_drawn() -> None:
    cells = np.argwhere(np.ones((1, 1, MAX_DRAWN_CUBES + 1))).tolist()
    assert preview_svg({"module_value": "cube", "cells": cells}) is None
    assert preview_svg({"module_value": "cube", "cells": []}) is None
