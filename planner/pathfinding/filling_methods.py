"""Filling methods: conversion of cells into chains, for each kind of module."""

from __future__ import annotations

from typing import Final, Protocol

from foldback.planner.chain.module import Filling
from foldback.planner.pathfinding.fill_cubes import Cubes
from foldback.planner.pathfinding.fill_tetrahedra import Tetrahedra
from foldback.planner.pathfinding.filled_shape import FilledShape
from foldback.planner.pathfinding.path_options import PathOptions
from foldback.planner.shapes.shape import Shape


class FillingMethod(Protocol):
    """Conversion of cells into chains of one kind of module."""

    def cells_for(self, options: PathOptions) -> int:
        """Return the number of cells for the voxelisation of a solid."""
        ...

    def modules_of(self, shape: Shape, options: PathOptions, *, of_solid: bool) -> int:
        """Return the number of modules of given cells, as far as it is known beforehand."""
        ...

    def fill(
        self, shape: Shape, options: PathOptions, *, of_solid: bool, seed: int, time_limit_s: float
    ) -> FilledShape:
        """Find chains through cells.

        Args:
            shape: The cells.
            options: Options of the chains.
            of_solid: True if the cells are voxels of a solid, requested by ``cells_for``.
            seed: Seed of all random choices.
            time_limit_s: Wall-clock limit of the search, s.

        Raises:
            InputError: The cells do not allow what the options request.
        """
        ...

    def check(self, shape: Shape, options: PathOptions) -> None:
        """Refuse given cells that cannot be filled if that is quickly proved."""
        ...


FILLING_METHODS: Final[dict[Filling | None, FillingMethod]] = {
    "cells": Cubes(),
    "rings": Tetrahedra(),
}
"""Method of filling a shape with a chain, by how its modules fill space."""
__all__ = ["FILLING_METHODS", "FilledShape", "FillingMethod"]
