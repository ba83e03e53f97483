"""Corners and faces of placed modules: where they are, and how low they reach."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from foldback.planner.arrays import Array, Flags, Ints
from foldback.planner.chain.module import Module, Piece

FACE_CELLS: Final = 8.0
"""Number of cells of a pitch in which the middles of faces are compared: two faces whose middles
are in the same one are taken for the same."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlacedFaces:
    """M faces of placed modules, module by module.

    Attributes:
        modules: (M,) module of each.
        numbers: (M,) number of each among the faces of its piece.
        normals: (M, 3) outward unit normals.
        middles: (M, 3) means of the corners.
        corners: (C, 3) corners of each, counterclockwise from outside.
    """

    modules: Ints
    numbers: Ints
    normals: Array
    middles: Array
    corners: list[Array]

    def outer(self) -> Flags:
        """Return (M,) flags of the faces that belong to one module only."""
        cells = np.rint(self.middles * FACE_CELLS).astype(np.int64)
        _, inverse, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
        return counts[inverse.reshape(-1)] == 1


def each_piece(module: Module, modules: int) -> Iterator[tuple[Piece, Ints | slice]]:
    """Yield the pieces of a chain of so many modules, each with the modules that are it."""
    if len(module.pieces) == 1:
        yield module.pieces[0], slice(None)
        return
    numbers = np.resize(module.piece_numbers, modules)
    for number, piece in enumerate(module.pieces):
        yield piece, np.flatnonzero(numbers == number)


def placed_corners(module: Module, positions: Array, rotations: Array) -> Array:
    """Return the (N, 3) corners of all full-size modules of a configuration.

    Args:
        module: The kind of module.
        positions: (n, 3) centres in pitches.
        rotations: (n, 3, 3) orientations.
    """
    return np.concatenate(
        [
            (
                piece.corners @ np.swapaxes(rotations[members], 1, 2) + positions[members, None]
            ).reshape(-1, 3)
            for piece, members in each_piece(module, len(positions))
        ]
    )


def lowest_corners(
    module: Module, positions: Array, rotations: Array, *, module_size: float = 1.0
) -> Array:
    """Return the (…, n) height of the lowest corner of each module, pitches.

    Args:
        module: The kind of module.
        positions: (…, n, 3) centres in pitches.
        rotations: (…, n, 3, 3) orientations.
        module_size: Module size as a fraction of the pitch.
    """
    lowest = np.empty(positions.shape[:-1])
    upward = rotations[..., 2, :]
    for piece, members in each_piece(module, positions.shape[-2]):
        corners = (piece.corners * module_size).T
        lowest[..., members] = (upward[..., members, :] @ corners).min(axis=-1)
    return lowest + positions[..., 2]


def placed_faces(module: Module, positions: Array, rotations: Array, members: Ints) -> PlacedFaces:
    """Return the faces of some full-size modules of a configuration.

    Args:
        module: The kind of module.
        positions: (n, 3) centres in pitches.
        rotations: (n, 3, 3) orientations.
        members: Numbers of the modules.
    """
    modules: list[Ints] = []
    numbers: list[Ints] = []
    normals: list[Array] = []
    corners: list[Array] = []
    is_member = np.isin(np.arange(len(positions)), members)
    for piece, all_of_piece in each_piece(module, len(positions)):
        some = np.arange(len(positions))[all_of_piece]
        some = some[is_member[some]]
        turns, centres = rotations[some], positions[some, None]
        faces = ((part, *face) for part in piece.parts for face in part.faces)
        for number, (part, normal, loop) in enumerate(faces):
            modules.append(some)
            numbers.append(np.full(len(some), number))
            normals.append(turns @ normal)
            corners.extend(centres + np.einsum("nij,cj->nci", turns, part.corners[list(loop)]))
    order = np.lexsort([np.concatenate(numbers), np.concatenate(modules)])
    return PlacedFaces(
        modules=np.concatenate(modules)[order],
        numbers=np.concatenate(numbers)[order],
        normals=np.concatenate(normals)[order],
        middles=np.array([face.mean(axis=0) for face in corners]).reshape(-1, 3)[order],
        corners=[corners[k] for k in order.tolist()],
    )
