"""Paths through shapes: an order in which a chain can visit every cell once.

What may be asked for stands here, and nothing that looks for a path: who checks a request, as pages
do, needs no compiler.
"""

from __future__ import annotations

from typing import Final, TypeAlias

Cell: TypeAlias = tuple[int, int, int]

METHODS: Final = ("auto", "blocks", "exact", "snake")
"""Ways to find a path that may be asked for."""
ENDS: Final = ("any", "surface")
"""Where a path may end: anywhere, or in cells with a free face."""
