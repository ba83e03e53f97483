"""Drawn shape: the cells of a word or a picture, in one part, with a thickness."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from foldback.planner.errors import InputError
from foldback.planner.pathfinding.path_options import PathOptions
from foldback.planner.shapes.bridges import parts_of
from foldback.planner.shapes.likeness import Likeness
from foldback.planner.shapes.shape import Shape
from foldback.planner.silhouettes.coarse_drawing import coarse_drawing
from foldback.planner.silhouettes.extrusion import extruded
from foldback.planner.silhouettes.joining import MAX_PARTS, joined
from foldback.planner.silhouettes.picture import Picture
from foldback.planner.silhouettes.word import Word

Drawing: TypeAlias = "Word | Picture"
"""What is drawn in cells before it is folded."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnShape:
    """Cells of a word or a picture.

    Attributes:
        shape: The cells; each becomes a block of modules.
        likeness: Likeness of the cells to the silhouette in a picture; None for a word.
        notes: Notes for people.
    """

    shape: Shape
    likeness: Likeness | None = None
    notes: tuple[str, ...] = ()


def drawn_shape(drawing: Drawing, options: PathOptions, cells: int) -> DrawnShape:
    """Return the cells of a word or a picture.

    Args:
        drawing: The word or picture.
        options: Options: modules, threshold, inside_out and thickness.
        cells: Requested number of cells of a picture.

    Raises:
        InputError: The picture has no silhouette, or one of too many parts.
    """
    if isinstance(drawing, Word):
        letters = joined(drawing.drawing).cells
        return DrawnShape(shape=extruded(letters, options.thickness, name=drawing.text))
    silhouette = drawing.silhouette(threshold=options.threshold, inside_out=options.inside_out)
    coarse = coarse_drawing(silhouette, max(1, round(cells / options.thickness)))
    parts = len(parts_of(coarse.cells)[1])
    if parts > MAX_PARTS:
        raise InputError(
            "too-many-parts",
            f"the picture has {parts} separate parts, expected at most {MAX_PARTS}; choose another "
            "threshold, turn it inside out, or remove small parts.",
        )
    bridged = joined(coarse.cells)
    count = float(bridged.cells.sum())
    likeness = Likeness(
        iou=coarse.shared / (count + coarse.area - coarse.shared),
        missing=1.0 - coarse.shared / coarse.area,
        added=1.0 - coarse.shared / count,
    )
    notes = drawing.notes
    if bridged.added:
        noun = "cell joins" if bridged.added == 1 else "cells join"
        notes += (f"{bridged.added} {noun} {parts} parts of the picture.",)
    shape = extruded(bridged.cells, options.thickness, name=drawing.name)
    return DrawnShape(shape=shape, likeness=likeness, notes=notes)
