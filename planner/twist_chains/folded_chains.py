"""Chains of codes and codes of chains: quarter turns as joint angles, and back."""

from __future__ import annotations

from typing import Final

import numpy as np

from foldback.planner.arrays import Flags, Ints
from foldback.planner.chain.built_in_modules import MODULE_NAMES, module_named, module_of
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.module import Module
from foldback.planner.chain.module_file import with_pattern
from foldback.planner.chain.rotations import wxyz_from_matrix
from foldback.planner.twist_chains.cube_sequence import CubeSequence
from foldback.planner.twist_chains.prism_lattice import (
    ENTRY,
    check_overlap,
    code_of_quarters,
)
from foldback.planner.twist_chains.snake_code import SnakeCode

SNAKE_MODULE: Final = "snake-prism"
"""Name of the module of a Rubik's snake."""
CUBE_MODULE: Final = "snake-cube"
"""Name of the module of a snake cube, which has straight pieces and corners."""
PIECES: Final = ("straight", "corner")
"""Names of its pieces."""
CODE_TOLERANCE_RAD: Final = 1e-3
"""Deviation of a joint from a whole quarter turn, in rad, up to which a chain has a code. Plans
state angles to 1e-4 rad or better."""


def snake_chain(code: SnakeCode, *, name: str = "snake") -> Chain:
    """Return the Rubik's snake that folds into a figure; the rod is its straight chain.

    Its prisms lie where ``places_of`` says.

    Raises:
        InputError: ``overlap`` if prisms of the figure lie in one another.
    """
    check_overlap(code)
    quarters = np.array(code.digits)
    angles = np.where(quarters == 3, -1, quarters) * (np.pi / 2)
    module = module_named(SNAKE_MODULE)
    first = module.piece(0)
    upright = first.entry_axes.T
    return Chain.from_angles(
        module,
        angles,
        name=name,
        first_position=ENTRY - upright @ first.entry,
        first_wxyz=wxyz_from_matrix(upright),
    )


def snake_code_of(chain: Chain) -> SnakeCode | None:
    """Return the code of a chain's folded shape; None for other modules or other angles."""
    if not _twists_by_quarters(chain.module) or chain.module.filling != "half-cells":
        return None
    quarters = quarters_of(chain)
    return None if quarters is None else code_of_quarters(quarters)


def cube_module(sequence: CubeSequence) -> Module:
    """Return the module of a snake cube with these pieces; equal sequences have the same one."""
    pattern = [PIECES[corner] for corner in sequence.corners]
    return module_of(with_pattern(module_named(CUBE_MODULE), pattern).document)


def cube_chain(cells: Ints, *, name: str = "snake cube") -> Chain:
    """Return the snake cube that folds into a path; the planar zigzag is its straight chain.

    A turn between two corners is made at the last joint before the second one.

    Args:
        cells: (n, 3) cells of the pieces, at least two; neighbours share a face.
        name: Name of the shape.

    Raises:
        InputError: ``overlap`` if a cell is visited twice.
    """
    steps = np.diff(cells, axis=0)
    corners = np.zeros(len(cells), dtype=np.bool_)
    corners[1:-1] = (steps[1:] != steps[:-1]).any(axis=1)
    frame = _frame(steps, corners)
    first = frame
    angles = np.zeros(len(steps))
    for joint in range(len(steps)):
        if corners[joint]:
            frame = np.stack([frame[:, 1], frame[:, 0], -frame[:, 2]], axis=1)
        if corners[joint + 1]:
            direction = steps[joint + 1]
            y, z = int(direction @ frame[:, 1]), int(direction @ frame[:, 2])
            angles[joint] = np.arctan2(z, y)
            frame = np.stack([frame[:, 0], direction, np.cross(frame[:, 0], direction)], axis=1)
    sequence = CubeSequence(tuple(corners.tolist()))
    return Chain.from_angles(
        cube_module(sequence),
        angles,
        name=name,
        first_position=cells[0].astype(np.float64),
        first_wxyz=wxyz_from_matrix(first.astype(np.float64)),
    )


def cube_sequence_of(chain: Chain) -> CubeSequence | None:
    """Return the pieces of a snake cube; None for other modules."""
    pieces = [chain.module.piece(module) for module in range(len(chain))]
    if not _twists_by_quarters(chain.module) or not all(piece.is_box for piece in pieces):
        return None
    corners = [bool(abs(piece.entry_axes[:, 0] @ piece.exit_axes[:, 0]) < 0.5) for piece in pieces]
    return CubeSequence((False, *corners[1:-1], False))


def has_code(chain: Chain) -> bool:
    """Return True if a chain's folded shape has a code."""
    return snake_code_of(chain) is not None or cube_sequence_of(chain) is not None


def _twists_by_quarters(module: Module) -> bool:
    """Return True if joints turn about the direction of the chain, in steps of a quarter turn."""
    return all(
        np.array_equal(piece.axes, piece.exit_axes[:, 0][None])
        and piece.step_rad is not None
        and abs(piece.step_rad - np.pi / 2) < CODE_TOLERANCE_RAD
        for piece in module.pieces
    )


def is_coded(name: str) -> bool:
    """Return True if a module of foldback's has this name, and chains of it have codes."""
    return name in MODULE_NAMES and _twists_by_quarters(module_named(name))


def quarters_of(chain: Chain) -> Ints | None:
    """Return (J,) quarter turns of the folded joints from angle zero of the module's file.

    None if one is no whole number.
    """
    angles = chain.folded_rad
    if chain.module.rest_rad is not None:
        angles = angles + np.resize(chain.module.rest_rad, len(angles))
    quarters = np.rint(angles / (np.pi / 2))
    if (np.abs(angles - quarters * (np.pi / 2)) > CODE_TOLERANCE_RAD).any():
        return None
    return quarters.astype(np.int64)


def _frame(steps: Ints, corners: Flags) -> Ints:
    """Return the frame of the first cube: x along the chain, y where the first corner leads."""
    along = steps[0]
    turns = np.flatnonzero(corners)
    sideways = steps[turns[0]] if len(turns) else np.roll(along, 1)
    return np.stack([along, sideways, np.cross(along, sideways)], axis=1)
