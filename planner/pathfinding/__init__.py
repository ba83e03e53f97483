"""Paths through shapes: an order in which a chain can visit every cell once.

The options of a request stand here without the searches, so that a check of a request, as in the
pages, needs no compiler.
"""

from __future__ import annotations

from typing import Final, TypeAlias

Cell: TypeAlias = tuple[int, int, int]

PATH_METHODS: Final = ("auto", "blocks", "exact", "snake")
"""Methods of searching a path through a shape that a request may name."""
PATH_ENDS: Final = ("any", "surface")
"""Where a request may want the two ends of a path through a shape: in any cells, or only in cells
with a free face."""
