"""Cells that a file lists: a path in their order, or a shape where they are asked for as voxels."""

from __future__ import annotations

from numpy.typing import ArrayLike

from planner.chain.path import DEFAULT_PITCH_M, Path
from planner.errors import InputError
from planner.readers.limits import Source
from planner.shapes.shape import Shape

REMEDY = "if these are voxels in no order, read them as voxels"


def path_or_shape(
    cells: ArrayLike, source: Source, *, name: str = "", pitch_m: float = DEFAULT_PITCH_M
) -> Path | Shape:
    """A path of cells in their order, or with ``source.as_voxels`` a shape.

    Raises:
        InputError: Naming the cells; where the order is to blame, saying how to read them else.
    """
    if source.as_voxels:
        return Shape.from_cells(cells, name=name or source.name or "shape", pitch_m=pitch_m)
    try:
        return Path.from_cells(cells, name=name or source.name or "path", pitch_m=pitch_m)
    except InputError as refusal:
        if refusal.code != "not-adjacent":
            raise
        detail = f"{refusal.detail.removesuffix('.')}; {REMEDY}."
        raise InputError(refusal.code, detail, where=refusal.where) from refusal
