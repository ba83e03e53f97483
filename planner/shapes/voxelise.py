"""Voxeliser: turns a solid into a shape of about the requested number of cells."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from planner.arrays import Array, Flags
from planner.errors import InputError, checked_fraction
from planner.shapes.lattice_fits import MAX_FULL_EDGE_SAMPLES, FittedCells, Grid, Ladder, overlap
from planner.shapes.orientations import candidates
from planner.shapes.shape import MAX_CELLS, Shape
from planner.shapes.solid import Solid
from planner.shapes.voxel_choice import Chooser

POOR_IOU: Final = 0.5
"""Overlap of voxels and solid (IoU, 0 to 1) below which a note to the user says that the shape is
poorly preserved. Larger values say so more often. Chosen."""
MIN_IOU_GAIN: Final = 0.1
"""Minimum gain in overlap (IoU, 0 to 1) at which a note to the user recommends a smaller number of
modules. Larger values recommend it less often. Chosen."""
MIN_PRESERVED_SHARE: Final = 0.7
"""Fraction of a solid's volume in voxels below which the note about a poor overlap says that parts
are lost; above it, the note says that cells are thicker than the solid. Chosen."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Voxels:
    """A solid as cells.

    Attributes:
        shape: Its cells, in one piece; the smallest coordinates are 0.
        iou: Intersection over union of the cells with the solid (its largest body).
        pitch: Edge of a cell in the solid's units.
        rotation: (3, 3) rotation of the solid.
        offset: (3,) shift in cells: a point x of the solid lies in ``floor(R x / pitch + offset)``.
        asked: Requested number of cells.
        below: Nearest smaller count that a request for it gives, or None.
        above: Nearest larger count that a request for it gives, or None.
        bodies: Number of bodies of the solid; the largest was kept.
        notes: Messages about lost, joined and omitted parts.
    """

    shape: Shape
    iou: float
    pitch: float
    rotation: Array
    offset: Array
    asked: int
    below: int | None
    above: int | None
    bodies: int
    notes: tuple[str, ...] = ()


def voxelise(solid: Solid, *, cells: int, seed: int = 0) -> Voxels:
    """Convert a solid into about ``cells`` cells.

    What comes within a tenth of the count and keeps the most of the shape is taken; where nothing
    does, the nearest count. The counts offered next to it are those that asking for them gives.

    Args:
        solid: Solid to voxelise.
        cells: Requested number of cells.
        seed: Seed of the random orientations.

    Raises:
        InputError: The count is out of range, or the solid has no inside.
    """
    if not 1 <= cells <= MAX_CELLS:
        raise InputError(
            "wrong-count", f"got a request for {cells} cells, expected 1 to {MAX_CELLS}."
        )
    turns = candidates(solid, np.random.default_rng(seed))
    ladder = Ladder(solid, turns)
    chooser = Chooser(ladder)
    made = chooser.choose(cells).made
    below, above = chooser.offers(cells)
    fine = ladder.grid(
        made.turn,
        made.pitch,
        ladder.finer(made.turn, made.pitch, 2 * MAX_FULL_EDGE_SAMPLES),
        exact=True,
    )
    filled_cells = np.argwhere(made.joined.cells)
    at = np.array(made.offset_threshold[:3]) * (fine.size // fine.split)
    iou = overlap(fine, made.offset_threshold, made.joined.cells)
    better = below is not None and chooser.choose(below).made.iou > iou + MIN_IOU_GAIN
    return Voxels(
        shape=Shape.from_cells(filled_cells - filled_cells.min(axis=0), name=solid.name),
        iou=iou,
        pitch=made.pitch,
        rotation=ladder.turns[made.turn],
        offset=(fine.offset - at) / fine.size - filled_cells.min(axis=0),
        asked=cells,
        below=below,
        above=above,
        bodies=ladder.bodies,
        notes=tuple(_notes(ladder, fine, made, iou, better=better)),
    )


def _notes(ladder: Ladder, fine: Grid, made: FittedCells, iou: float, *, better: bool) -> list[str]:
    notes: list[str] = []
    if ladder.bodies > 1:
        notes.append(
            f"the mesh has {ladder.bodies} separate bodies; only the largest, with "
            f"{100 * ladder.share:.0f} % of the volume, is used. Join the bodies, or "
            "fold them one by one."
        )
    if fine.crossed > 0.001:
        notes.append("the surface crosses itself; everything it encloses counts as inside.")
    joined = made.joined
    if joined.added:
        word = "cell was" if joined.added == 1 else "cells were"
        notes.append(f"{joined.added} {word} added to keep thin parts connected.")
    if joined.dropped:
        word, verb = ("cell", "was") if joined.dropped == 1 else ("cells", "were")
        notes.append(f"{joined.dropped} {word} not connected to the rest {verb} removed.")
    filled = fine.fill(made.offset_threshold).astype(np.float64)
    total = max(float(filled.sum()), np.finfo(float).tiny)
    kept = checked_fraction(float(filled[joined.cells].sum()) / total, "share of the volume")
    lost = checked_fraction(_volume_apart(joined.cells, filled) / total, "share that is lost")
    if lost > 0.005:
        notes.append(
            f"{100 * lost:.1f} % of the shape's volume is in parts thinner than a cell and is "
            "lost; use more modules to keep it."
        )
    if iou < POOR_IOU and kept < MIN_PRESERVED_SHARE:
        notes.append(
            f"the cells contain only {100 * kept:.0f} % of the shape's volume; use more modules."
        )
    elif iou < POOR_IOU:
        notes.append(
            f"the shape is thinner than a cell, and the match between cells and shape is only "
            f"{100 * iou:.0f} %; use more modules."
        )
    if better:
        notes.append("use fewer modules; then the cells would match the shape better.")
    return notes


def _volume_apart(cells: Flags, filled: Array) -> float:
    """Return the samples in cells that are left out and touch none that is kept."""
    near = np.pad(cells, 1)
    for axis in range(3):
        near = near | np.roll(near, 1, axis) | np.roll(near, -1, axis)
    return float(filled[~near[1:-1, 1:-1, 1:-1]].sum())
