"""Voxeliser: turns a solid into a shape of about the requested number of cells."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from foldback.planner.arrays import Array, Flags
from foldback.planner.errors import InputError, checked_fraction
from foldback.planner.shapes.lattice_fits import (
    MAX_FULL_EDGE_SAMPLES,
    FittedCells,
    Grid,
    Ladder,
    overlap,
)
from foldback.planner.shapes.orientations import candidates
from foldback.planner.shapes.separate_bodies import MAX_CROSSED_SHARE, bodies_note, percent
from foldback.planner.shapes.shape import MAX_CELLS, Shape
from foldback.planner.shapes.solid import Solid
from foldback.planner.shapes.tunnels import tunnels_of_cells
from foldback.planner.shapes.voxel_choice import Chooser

POOR_IOU: Final = 0.5
"""Overlap of voxels and solid (IoU, 0 to 1) below which a note to the user says that the shape is
poorly preserved."""


PART_LOST_SHARE: Final = 0.005
"""Share of a solid's volume (0 to 1) in parts that cells leave out, above which the parts count as
lost."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Retention:
    """What cells keep of a solid.

    Attributes:
        iou: Intersection over union of the cells with the whole solid, all of its bodies.
        volume: Share of the whole solid's volume inside the cells, 0…1.
        lost: Share of the used body's volume in parts that the cells leave out, 0…1.
        tunnels: Number of tunnels of the cells.
        parts: True if no part is lost: neither volume nor a tunnel.
    """

    iou: float
    volume: float
    lost: float
    tunnels: int
    parts: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Voxels:
    """A solid as cells.

    Attributes:
        shape: Its cells, in one piece; the smallest coordinates are 0.
        retention: What they keep of the solid.
        pitch: Edge of a cell in the solid's units.
        rotation: (3, 3) rotation of the solid.
        offset: (3,) shift in cells: a point x of the solid lies in ``floor(R x / pitch + offset)``.
        requested_cells: Requested number of cells.
        below: Nearest smaller count that a request for it gives, or None.
        above: Nearest larger count that a request for it gives, or None.
        unused: Shares of the solid's volume of the separate bodies that are not used, the largest
            first.
        tunnels: Number of tunnels of the used bodies, such as that of a handle; None if undecided.
        notes: Messages about lost parts, the most important first.
        remarks: Messages about crossing surfaces, and about cells that were added or removed.
        joined: True if cells in the air join separate bodies.
    """

    shape: Shape
    retention: Retention
    pitch: float
    rotation: Array
    offset: Array
    requested_cells: int
    below: int | None
    above: int | None
    unused: tuple[float, ...]
    tunnels: int | None
    notes: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    joined: bool = False

    @property
    def iou(self) -> float:
        """Estimated intersection over union of the cells with the whole solid, all its bodies."""
        return self.retention.iou


def voxelise(solid: Solid, *, cells: int, seed: int = 0) -> Voxels:
    """Convert a solid into about ``cells`` cells; see ``voxels_for``.

    Args:
        solid: Solid to voxelise.
        cells: Requested number of cells.
        seed: Seed of the random orientations.

    Raises:
        InputError: The count is out of range, or the solid has no inside.
    """
    return voxels_for(chooser_for(solid, seed), cells)


def chooser_for(solid: Solid, seed: int) -> Chooser:
    """Return the choice among the fits of a solid; the seed gives the random orientations."""
    return Chooser(Ladder(solid, candidates(solid, np.random.default_rng(seed))))


def voxels_for(chooser: Chooser, cells: int, *, offering: bool = True) -> Voxels:
    """Convert a solid into about ``cells`` cells.

    What comes within a tenth of the count and keeps the most of the shape is taken; where nothing
    does, the nearest count. The counts offered next to it are those that asking for them gives.

    Args:
        chooser: The solid; it remembers what it found for other calls.
        cells: Requested number of cells.
        offering: True to search for the nearest other counts, which takes most of the time.

    Raises:
        InputError: The count is out of range, or the solid has no inside.
    """
    if not 1 <= cells <= MAX_CELLS:
        raise InputError(
            "wrong-count", f"got a request for {cells} cells, expected 1 to {MAX_CELLS}."
        )
    ladder = chooser.ladder
    fit = chooser.choose(cells).fit
    below, above = chooser.offers(cells) if offering else (None, None)
    fine = ladder.grid(
        fit.turn,
        fit.pitch,
        ladder.finer(fit.turn, fit.pitch, 2 * MAX_FULL_EDGE_SAMPLES),
        exact=True,
    )
    at = np.array(fit.offset_threshold[:3]) * (fine.size // fine.split)
    body_iou = overlap(fine, fit.offset_threshold, fit.joined.cells)
    better = below is not None and chooser.choose(below).fit.iou > body_iou + 0.1
    retention = _retention(ladder, fine, fit)
    laid = LaidCells(
        cells=fit.joined.cells,
        pitch=fit.pitch,
        rotation=ladder.turns[fit.turn],
        offset=(fine.offset - at) / fine.size,
    )
    voxels = voxels_of(ladder, laid, retention, body_iou, requested_cells=cells)
    advice = ("use fewer modules; then the cells would match the shape better.",) if better else ()
    return replace(
        voxels,
        below=below,
        above=above,
        notes=(*voxels.notes, *advice),
        remarks=tuple(_remarks(fine, fit)),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LaidCells:
    """Cells over a solid: a point x of it lies in the cell ``floor(R x / pitch + offset)``.

    Attributes:
        cells: (X, Y, Z) True for the cells.
        pitch: Edge of a cell in the solid's units.
        rotation: (3, 3) rotation of the solid, R.
        offset: (3,) shift in cells.
    """

    cells: Flags
    pitch: float
    rotation: Array
    offset: Array


def voxels_of(
    ladder: Ladder, laid: LaidCells, retention: Retention, body_iou: float, *, requested_cells: int
) -> Voxels:
    """Return cells as voxels of a solid, with notes about what they lose.

    Args:
        ladder: The solid.
        laid: The cells.
        retention: What they keep.
        body_iou: Intersection over union with the used body.
        requested_cells: Requested number of cells.
    """
    cells = np.argwhere(laid.cells)
    offset = laid.offset - cells.min(axis=0)
    shape = Shape.from_cells(cells - cells.min(axis=0), name=ladder.solid.name)
    unused = _unused(ladder, shape, laid.rotation / laid.pitch, offset)
    notes = _notes(ladder, retention, body_iou)
    if unused:
        notes.insert(0, bodies_note([body.share for body in ladder.bodies], unused))
    return Voxels(
        shape=shape,
        retention=retention,
        pitch=laid.pitch,
        rotation=laid.rotation,
        offset=offset,
        requested_cells=requested_cells,
        below=None,
        above=None,
        unused=tuple(unused),
        tunnels=ladder.tunnels,
        notes=tuple(notes),
    )


def _retention(ladder: Ladder, grid: Grid, fit: FittedCells) -> Retention:
    iou = overlap(grid, fit.offset_threshold, fit.joined.cells, share=ladder.share)
    filled = grid.fill(fit.offset_threshold).astype(np.float64)
    return measure_retention(ladder, fit.joined.cells, filled, iou)


def measure_retention(ladder: Ladder, cells: Flags, filled: Array, iou: float) -> Retention:
    """Return what cells keep of a solid.

    Args:
        ladder: The solid.
        cells: (X, Y, Z) True for the cells.
        filled: (X, Y, Z) volume of the used body in each cell of the lattice, in any unit.
        iou: Intersection over union of the cells with the whole solid.
    """
    total = max(float(filled.sum()), np.finfo(float).tiny)
    inside = checked_fraction(float(filled[cells].sum()) / total, "share of the volume")
    lost = checked_fraction(_volume_apart(cells, filled) / total, "share that is lost")
    tunnels = tunnels_of_cells(cells)
    return Retention(
        iou=iou,
        volume=inside * ladder.share,
        lost=lost,
        tunnels=tunnels,
        parts=lost <= PART_LOST_SHARE and (ladder.tunnels is None or tunnels >= ladder.tunnels),
    )


def _unused(ladder: Ladder, shape: Shape, turn: Array, offset: Array) -> list[float]:
    """Return the shares of the bodies that no cell contains a point of."""
    unused_bodies = ladder.bodies[1:]
    if ladder.share == 1.0 and unused_bodies:
        cells = {tuple(cell) for cell in shape.cells.tolist()}
        unused_bodies = [
            body
            for body in unused_bodies
            if not any(
                tuple(cell) in cells
                for cell in np.floor(body.points @ turn.T + offset).astype(np.int64).tolist()
            )
        ]
    return [body.share for body in unused_bodies]


def _notes(ladder: Ladder, retention: Retention, body_iou: float) -> list[str]:
    notes: list[str] = []
    inside = retention.volume / ladder.share
    of_shape = "shape's volume" if ladder.share == 1.0 else "used body's volume"
    if body_iou < POOR_IOU and inside < 0.7:
        notes.append(_volume_note(inside, retention.lost, of_shape))
    elif retention.lost > PART_LOST_SHARE:
        notes.append(
            f"{percent(retention.lost)} of the {of_shape} is in thin parts that are left out; use "
            "more modules to keep them."
        )
    elif body_iou < POOR_IOU:
        notes.append("parts of the shape are thinner than a cell; use more modules.")
    if ladder.tunnels is not None and retention.tunnels < ladder.tunnels:
        notes.append(_tunnels_note(ladder.tunnels, retention.tunnels))
    return notes


def _remarks(fine: Grid, fit: FittedCells) -> list[str]:
    notes: list[str] = []
    if fine.crossed > MAX_CROSSED_SHARE:
        notes.append("the surface crosses itself; everything it encloses counts as inside.")
    joined = fit.joined
    if joined.added:
        word = "cell was" if joined.added == 1 else "cells were"
        notes.append(f"{joined.added} {word} added to keep thin parts connected.")
    if joined.dropped:
        word, verb = ("cell", "was") if joined.dropped == 1 else ("cells", "were")
        notes.append(f"{joined.dropped} {word} not connected to the rest {verb} removed.")
    return notes


def _volume_note(inside: float, lost: float, of_shape: str) -> str:
    """Return the note about volume outside of the cells: its parts add up to what is missing."""
    lost_percent = round(100 * lost)
    shares = (
        (lost_percent, "in thin parts that are left out"),
        (100 - round(100 * inside) - lost_percent, "outside of the cells"),
    )
    parts = [f"{share} % of the {of_shape} is {outcome}" for share, outcome in shares if share > 0]
    return f"{' and '.join(parts)}. Use more modules."


def _tunnels_note(of_solid: int, of_cells: int) -> str:
    is_one = of_solid == 1
    holes = "1 hole" if is_one else f"{of_solid} holes"
    cells = "none" if of_cells == 0 else f"only {of_cells}"
    return (
        f"the shape has {holes} through it, such as {'that' if is_one else 'those'} of a ring or "
        f"a handle; the cells have {cells}. Use more modules."
    )


def _volume_apart(cells: Flags, filled: Array) -> float:
    """Return the samples in cells that are left out and touch none that is kept."""
    near = np.pad(cells, 1)
    for axis in range(3):
        near = near | np.roll(near, 1, axis) | np.roll(near, -1, axis)
    return float(filled[~near[1:-1, 1:-1, 1:-1]].sum())
