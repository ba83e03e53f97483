"""Filling: how cells become chains of modules of one kind."""

from __future__ import annotations

from typing import Final, Protocol

from planner.chain.module import CUBE, TETRAHEDRON
from planner.pathfinding.fill_cubes import Cubes
from planner.pathfinding.fill_tetrahedra import Tetrahedra
from planner.pathfinding.filled import Filled
from planner.pathfinding.options import PathOptions
from planner.shapes.shape import Shape


class Filling(Protocol):
    """How cells become chains of modules of one kind."""

    def cells_for(self, options: PathOptions) -> int:
        """How many cells a solid should be voxelised into."""
        ...

    def modules_of(self, shape: Shape, options: PathOptions) -> int:
        """How many modules given cells become, as far as that is known beforehand."""
        ...

    def fill(
        self, shape: Shape, options: PathOptions, *, of_solid: bool, seed: int, time_limit_s: float
    ) -> Filled:
        """Finds chains through cells.

        Args:
            shape: The cells.
            options: How they are to become chains.
            of_solid: Whether they come from a solid, and were asked for by ``cells_for``.
            seed: What randomness starts from.
            time_limit_s: How long may be searched.

        Raises:
            InputError: For a wish that these cells can't fulfil.
        """
        ...

    def check(self, shape: Shape, options: PathOptions) -> None:
        """Refuses given cells that can't be filled, for a reason that is quickly found."""
        ...


FILLINGS: Final[dict[str, Filling]] = {CUBE.name: Cubes(), TETRAHEDRON.name: Tetrahedra()}
"""By the name of the module."""

__all__ = ["FILLINGS", "Filled", "Filling"]
