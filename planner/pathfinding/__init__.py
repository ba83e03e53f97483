"""Paths through shapes: an order in which a chain can visit every cell once.

The options of a request stand here without the searches, so that a check of a request, as in the
pages, needs no compiler.
"""

from __future__ import annotations

from typing import Final, TypeAlias

from foldback.planner.chain.module import Filling
from foldback.planner.parameters.option import Choice, Choices

Cell: TypeAlias = tuple[int, int, int]

FILLINGS: Final[tuple[Filling, ...]] = ("cells", "rings")
"""Ways of filling space for which a chain is found through the cells of a shape; each has a method
in ``planner.pathfinding.filling_methods``."""

PATH_METHODS: Final[Choices] = {
    "auto": Choice(label="Auto", hint="Picks the best method for this shape."),
    "blocks": Choice(
        label="Blocks",
        hint="Splits each cell of the shape into 2×2×2 modules. A path always exists, and the "
        "chain folds most reliably.",
    ),
    "fitted": Choice(
        label="Fitted",
        hint="For meshes: chooses the cells together with the path through them. Looks most like "
        "the mesh.",
    ),
    "exact": Choice(
        label="Exact",
        hint="Uses one module for each cell of the shape: finer detail for the same number of "
        "modules, but there may be no path. For meshes: meets the number of modules exactly.",
    ),
    "snake": Choice(
        label="Snake", hint="Goes back and forth, layer by layer. Works only for boxes."
    ),
}
"""Methods of searching a path through a shape that a request may name."""
PATH_ENDS: Final[Choices] = {
    "any": Choice(label="Anywhere", hint="The ends may be inside the folded shape."),
    "surface": Choice(
        label="On the surface",
        note="both on the outside",
        hint="Both ends stay within reach, for example for a cable.",
    ),
}
"""Where a request may want the two ends of a path through a shape: in any cells, or only in cells
with a free face."""
