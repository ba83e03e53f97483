"""Options of the conversion of a shape into a chain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from planner.chain.module import CUBE, MODULES
from planner.errors import InputError
from planner.parameters.parameters import WORLDS, World
from planner.pathfinding import PATH_ENDS, PATH_METHODS, Cell

DEFAULT_MODULES: Final = 160
"""Number of modules into which a mesh is divided if the request states none. Larger values follow
the mesh more closely, and fold more slowly. Chosen."""
MODULE_COUNTS: Final = (8, 20_000)
"""Minimum and maximum number of modules that a request may ask for; other numbers are refused.
Chosen."""
MAX_TABLE_MODULES: Final = 96
"""Maximum number of modules of the variants of a shape that are offered for folding on a table;
larger ones mostly get stuck. Measured: tori of 88 and 96 fold in six to eight minutes of processor
time, one of 160 gets stuck (decision 0026)."""


def table_warning(modules: int, world: World) -> str:
    """Return what to know before a long chain folds on a table; empty if there is nothing."""
    if world != "table" or modules <= MAX_TABLE_MODULES:
        return ""
    return f"Chains of more than {MAX_TABLE_MODULES} modules usually get stuck on a table."


@dataclass(frozen=True, slots=True, kw_only=True)
class PathOptions:
    """Options of the conversion of a shape into a chain.

    Attributes:
        module: Kind of module: ``cube`` or ``tetrahedron``. Chain files state their own.
        modules: Approximate number of modules; None for that of the input, or 160 for a mesh.
        method: ``auto``, ``blocks``, ``exact`` or ``snake``.
        repair: True if cells may be added or dropped without a path otherwise.
        ends: ``any``, or ``surface`` for both ends on the outside.
        as_voxels: True to read a list of cells as a shape, not as a path.
        start: First cell of the chain in the coordinates of the preview; None for any.
        world: World of the fold: ``floating`` or on a ``table``.
    """

    module: str = CUBE.name
    modules: int | None = None
    method: str = "auto"
    repair: bool = False
    ends: str = "any"
    as_voxels: bool = False
    start: Cell | None = None
    world: World = "floating"

    def check(self) -> None:
        """Refuse invalid options.

        Raises:
            InputError: An option is invalid; names it.
        """
        low, high = MODULE_COUNTS
        if self.modules is not None and not low <= self.modules <= high:
            raise InputError(
                "bad-modules", f"got {self.modules} modules, expected {low} to {high}."
            )
        for name, value, known in (
            ("module", self.module, tuple(MODULES)),
            ("method", self.method, PATH_METHODS),
            ("ends", self.ends, PATH_ENDS),
            ("world", self.world, WORLDS),
        ):
            if value not in known:
                raise InputError(
                    f"unknown-{name}",
                    f"got the {name} {value!r}, expected one of: {', '.join(known)}.",
                )
