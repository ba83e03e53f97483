"""Chains and random configurations for tests."""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.module import Module
from foldback.planner.chain.path import Path
from foldback.planner.core import grow
from foldback.planner.motion.motion import Motion, Phase
from foldback.planner.pathfinding.lattice import neighbours
from foldback.planner.simulation.reduced_state import State, turned

Array = NDArray[np.float64]


def chain_of(cells: ArrayLike, name: str = "cells") -> Chain:
    """Return a chain that folds into the cells of a path."""
    return Chain.from_path(Path.from_cells(cells, name=name))


def line(modules: int) -> Chain:
    """Return a chain whose folded configuration is straight."""
    return chain_of([(i, 0, 0) for i in range(modules)], "line")


def coil(modules: int) -> Chain:
    """Return a chain that folds into stacked layers of 2 × 2 cells."""
    turns = [(0, 0), (1, 0), (1, 1), (0, 1)]
    there_and_back = [*turns, *turns[::-1]]
    cells = [(*there_and_back[i % 8], i // 4) for i in range(modules)]
    return chain_of(cells, "coil")


COIL = Path.from_cells(np.round(coil(12).folded_poses.positions).astype(int), name="coil")
"""Short path that folds quickly."""
SQUARE: Final = Path.from_cells(
    [(0, 0, 0), (1, 0, 0), (2, 0, 0), (2, 1, 0), (1, 1, 0), (0, 1, 0), (0, 2, 0), (1, 2, 0)],
    name="square",
)
"""Short path of eight cells in a plane."""
HAIRPIN: Final = Path.from_cells(
    [*((x, 0, 0) for x in range(4)), *((x, 1, 0) for x in reversed(range(4)))], name="hairpin"
)
"""Another path of eight cells in a plane."""


def shuffled(sides: tuple[int, int, int], moves: int, seed: int) -> Chain:
    """Return a box along a random path, made by ``moves`` moves per cell."""
    cells = np.argwhere(np.ones(sides, dtype=bool))
    count, order = grow(neighbours(cells), np.ones(len(cells), bool), -1, moves * len(cells), seed)
    assert count == len(cells)
    return chain_of(cells[order], "box")


def unvalidated(module: Module, folded_rad: Array) -> Chain:
    """Return a chain whose modules may overlap when it is folded."""
    pose = {"folded_position": np.zeros(3), "folded_wxyz": np.eye(4)[0]}
    return Chain(name="unchecked", module=module, folded_rad=folded_rad, **pose)


def random_angles(chain: Chain, rng: np.random.Generator, maximum: float = 1.5) -> Array:
    """Return (J,) random hinge angles."""
    return rng.uniform(-maximum, maximum, len(chain.folded_rad))


def random_rotation(rng: np.random.Generator) -> Array:
    """Return a random (3, 3) rotation."""
    return turned(rng.normal(size=3) * 2.0)


def folded_state(chain: Chain) -> State:
    """Return the state of a folded chain at rest."""
    poses = chain.folded_poses
    return State.at_rest(chain.folded_rad, poses.positions[chain.root], poses.rotations[chain.root])


def near_pairs_of(modules: int) -> NDArray[np.int64]:
    """Return all (P, 2) pairs of modules that are not linked."""
    return np.stack(np.triu_indices(modules, 2), axis=1)


def random_state(chain: Chain, seed: int, maximum: float = 0.3) -> State:
    """Return a random state in motion, with angles small enough to avoid overlaps."""
    rng = np.random.default_rng(seed)
    return State(
        angles=random_angles(chain, rng, maximum),
        rates=rng.normal(size=len(chain.folded_rad)) * 0.3,
        position=rng.normal(size=3),
        rotation=random_rotation(rng),
        velocity=rng.normal(size=3),
        spin=rng.normal(size=3) * 0.3,
    )


def knotted(tail: int = 6) -> Chain:
    """Return a trefoil of thick cells with two loose ends.

    It is drawn on a 5 × 5 grid, two cells wide: vertical strokes in one layer, horizontal ones two
    layers below. The stroke at the right is omitted, and its ends lead away to the right.
    """
    corners = [(8 + tail, 2, 0)]
    row = 1
    for column in (1, 3, 0, 2):
        # Along the row to the column at the bottom, up, along the column at the top, down.
        to = (column + 2) % 5 if row == column else column
        corners += [(2 * column, 2 * row, 0), (2 * column, 2 * row, 2)]
        corners += [(2 * column, 2 * to, 2), (2 * column, 2 * to, 0)]
        row = to
    corners.append((8 + tail, 2 * row, 0))
    return chain_of(walk(corners), "knot")


def walk(corners: ArrayLike, scale: int = 1) -> NDArray[np.int64]:
    """Return the cells along straight lines between corners."""
    points = scale * np.array(corners)
    cells = [points[0]]
    for corner in points[1:]:
        while (cells[-1] != corner).any():
            axis = int(np.argmax(corner != cells[-1]))
            cells.append(cells[-1] + np.sign(corner - cells[-1]) * (np.arange(3) == axis))
    return np.array(cells)


def anchored(
    phase: Phase, angles: Array, *, time_s: Array | None = None, error_rad: Array | None = None
) -> Motion:
    """Return frames with module 0 upright at the origin, 1 s apart by default."""
    count = len(angles)
    return Motion.from_frames(
        phase=phase,
        time_s=np.arange(count, dtype=np.float64) if time_s is None else time_s,
        joint_angles_rad=angles,
        root_position=np.zeros((count, 3)),
        root_wxyz=np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
        joint_error_rad=error_rad,
    )
