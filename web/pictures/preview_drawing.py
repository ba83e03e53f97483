"""Drawings of previews, which pages show until the 3D view has loaded, or instead of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from foldback.planner.chain.built_in_modules import module_of
from foldback.planner.chain.rotations import matrix_from_wxyz
from foldback.web.pictures.isometric import isometric_svg
from foldback.web.pictures.isometric_modules import modules_drawing

MAX_DRAWN_CUBES: Final = 20_000
"""Maximum number of cubes in the drawing of an uploaded shape; larger shapes have no drawing.
Drawing this number takes 0.2 s. Measured."""
DRAWING_SIZE_PX: Final = 480
"""Nominal width and height of the drawing of an uploaded shape, in CSS pixels. As an SVG it can be
scaled without loss."""


def preview_svg(report: Mapping[str, Any], added: Sequence[Sequence[int]] = ()) -> str | None:
    """Draw the modules of a preview's report, or its cells if there is no chain.

    Without a path, the cells that prevent it are red, as in the 3D view.

    Args:
        report: Result of ``planner.pipeline.prepare.Preparation.report``.
        added: Cells that an offered repair adds, to draw in blue.

    Returns:
        The drawing; None when there is nothing to draw, or too much.
    """
    module = module_of(report["module_value"])
    if report.get("wxyzs"):
        positions = np.asarray(report["positions"], dtype=np.float64)
        if len(positions) > 4_000:
            return None
        rotations = matrix_from_wxyz(np.asarray(report["wxyzs"], dtype=np.float64))
        return modules_drawing(module, positions, rotations).svg(size=DRAWING_SIZE_PX)
    cells = np.asarray(report["cells"], dtype=np.int64).reshape(-1, 3)
    if not 0 < len(cells) <= MAX_DRAWN_CUBES:
        return None
    state = {} if report.get("has_path") else report.get("feasibility") or {}
    odd = [cell for problem in state.get("problems", ()) for cell in problem["cells"]]
    return isometric_svg(cells, size=DRAWING_SIZE_PX, odd=odd, added=added)
