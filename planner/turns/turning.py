"""Turning: what a search for turns needs to know of a kind of modules."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Array, Flags, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import forward_kinematics
from foldback.planner.chain.rotations import QUARTER_RAD
from foldback.planner.core import TABLE_FULL
from foldback.planner.core.structures import Levels

Keys = NDArray[np.uint64]

KernelArrays = tuple[object, ...]
"""Named tuple of arrays and numbers that kernels get as one argument."""


class Turns(NamedTuple):
    """Turns of some states, clear or not.

    Attributes:
        parent: (M,) number of the state that turns.
        hinge: (M,) hinge that turns.
        change: (M,) −1 or 1: change of its level.
        score: (M,) score of the new state, the lower the better; 0 if all hinges are straight.
        key: (M,) key of the new state.
    """

    parent: Ints
    hinge: Ints
    change: Ints
    score: Array
    key: Keys


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnKernels:
    """Kernels of quarter turns of one kind of module.

    The first four are the compiled functions of these names, which get the table and the scratch
    arrays of their kind: see ``planner/core/cube_turns.cpp`` and
    ``planner/core/tetrahedron_turns.cpp``.

    Attributes:
        count_contacts: Counts touching pairs after each turn of a state.
        test_turns: Tests which turns of a state are clear.
        clear_turns: Counts the clear turns at the start of a sequence.
        without_overlaps: Finds the states in which no two modules share a cell.
        double_table: Returns a table of twice the size, in which entries may be lost.
    """

    count_contacts: Callable[..., None]
    test_turns: Callable[..., int]
    clear_turns: Callable[..., int]
    without_overlaps: Callable[..., Flags]
    double_table: Callable[..., KernelArrays]


class Turning:
    """Turns by one level of one hinge of a chain, with the shorter part as a rigid body.

    A state has one level for each hinge: −1, 0 or 1 times ``QUARTER_RAD``. What is known of the
    distances of turning modules is kept in a table, which grows when it is full.

    Args:
        chain: The chain.
        module_size: Module size as a fraction of the pitch.
        width: Number of states that a search for turns keeps at first.
        kernels: Kernels for the kind of module.
        table: Table of distances that the kernels fill.
        scratch: Arrays that the kernels use for one state at a time.

    Attributes:
        width: Number of states that a search for turns keeps at first.
        folded: (J,) levels of the folded chain.
        size: Module size as a fraction of the pitch.
        step_rad: Angle of a level.
        cell_gap: Gap between modules in neighbouring cells, pitches.
    """

    def __init__(
        self,
        chain: Chain,
        module_size: float,
        *,
        width: int,
        kernels: TurnKernels,
        table: KernelArrays,
        scratch: KernelArrays,
    ) -> None:
        self.width = width
        self.size = module_size
        self.step_rad = QUARTER_RAD
        self.cell_gap = gap_between_cells(chain, module_size)
        self.folded: Levels = np.rint(chain.folded_rad / QUARTER_RAD).astype(np.int8)
        self._module = chain.module
        self._kernels = kernels
        self._table = table
        self._scratch = scratch

    def turns(self, states: Levels, keys: Keys, codes: Keys, *, weight: float) -> Turns:
        """Return all turns of some states after which no two modules share a cell.

        Args:
            states: (B, J) levels.
            keys: (B,) key of each state.
            codes: (J, 3) random bits of each level of each hinge; the key of a state is the
                exclusive or of those of its levels.
            weight: Weight of a pair of touching modules in the score; a bent hinge counts 1.
        """
        contacts: Ints = np.empty((*states.shape, 2), np.int64)
        for k in range(len(states)):
            self._kernels.count_contacts(states[k], self._scratch, contacts[k])
        parent, hinge, up = np.nonzero(contacts >= 0)
        before = states[parent, hinge].astype(np.int64)
        change = 2 * up - 1
        after = before + change
        bent = np.count_nonzero(states, axis=1)[parent] + np.abs(after) - np.abs(before)
        return Turns(
            parent=parent,
            hinge=hinge,
            change=change,
            score=bent + weight * contacts[parent, hinge, up],
            key=keys[parent] ^ codes[hinge, before + 1] ^ codes[hinge, after + 1],
        )

    def are_clear(self, states: Levels, turns: Turns, numbers: Ints, *, room: float) -> Flags:
        """Return (T,) True for turns that are clear.

        Args:
            states: (B, J) levels.
            turns: Turns of these states.
            numbers: (T,) numbers of the turns that are tested.
            room: Distance that modules must keep, pitches.
        """
        clear = np.zeros(len(numbers), np.bool_)
        parents = turns.parent[numbers]
        for parent in np.unique(parents).tolist():
            rows = np.flatnonzero(parents == parent)
            hinges, changes = turns.hinge[numbers[rows]], turns.change[numbers[rows]]
            flags = np.zeros(len(rows), np.bool_)
            self._with_table(self._kernels.test_turns, states[parent], hinges, changes, room, flags)
            clear[rows] = flags
        return clear

    def pairs(self, state: Levels) -> Levels:
        """Return states that are one turn of each of two hinges away, without overlaps.

        Both hinges get straight; or one does while the other one bends, and the pair is symmetric:
        the hinges are parallel and turn against each other, so that all beyond them moves without
        turning. In a packed chain, such a part may be able to leave where one that turns is not.

        Args:
            state: (J,) levels.

        Returns:
            (M, J) levels: first those with both hinges straight, each kind in the order of the
            distance of the hinges along the chain.
        """
        hinge, up = np.nonzero(np.abs(state[:, None] + np.array([-1, 1])) <= 1)
        change = 2 * up - 1
        straightens = state[hinge] != 0
        axis = change * self._hinge_axes(state)[hinge]
        first, second = np.triu_indices(len(hinge), 1)
        symmetric = axis[first] == -axis[second]
        gain = straightens[first].astype(np.int64) + straightens[second]
        useful = (hinge[first] != hinge[second]) & ((gain == 2) | ((gain == 1) & symmetric))
        first, second = first[useful], second[useful]
        order = np.lexsort((hinge[second] - hinge[first], -gain[useful]))
        first, second = first[order], second[order]
        states = np.repeat(state[None], len(order), axis=0)
        for turn in (first, second):
            states[np.arange(len(order)), hinge[turn]] += change[turn].astype(np.int8)
        return states[self._kernels.without_overlaps(states, self._scratch)]

    def _hinge_axes(self, state: Levels) -> Ints:
        """Return the (J,) axes of all hinges of a state: ±1, ±2, ±3 for x, y, z of the world."""
        module = self._module
        angles_rad = QUARTER_RAD * state.astype(float)
        rotations = forward_kinematics(module, angles_rad).rotations[module.rigid_links :]
        axes = np.empty((len(state), 3))
        joint, hinges = module.joint, module.hinges_per_joint
        rows = joint.row(module.rigid_links + np.arange(len(rotations) - 1))
        # The outermost hinge is fixed in the module before it, the innermost one in that behind.
        axes[::hinges] = (rotations[:-1] @ joint.axes[rows, 0, :, None])[:, :, 0]
        for hinge in range(1, hinges):
            inner = joint.turn[rows].swapaxes(1, 2) @ joint.axes[rows, hinge, :, None]
            axes[hinge::hinges] = (rotations[1:] @ inner)[:, :, 0]
        return np.rint(axes @ [1.0, 2.0, 3.0]).astype(np.int64)

    def clear_turns(self, start: Levels, hinges: Ints, changes: Ints, *, room: float) -> int:
        """Return the number of turns before the first that is not clear.

        Args:
            start: (J,) levels before the first turn.
            hinges, changes: (T,) hinge of each turn, and −1 or 1.
            room: Distance that modules must keep, pitches.
        """
        return self._with_table(self._kernels.clear_turns, start, hinges, changes, room)

    def _with_table(
        self,
        kernel: Callable[..., int],
        state: Levels,
        hinges: Ints,
        changes: Ints,
        room: float,
        *results: Flags,
    ) -> int:
        """Return the result of a kernel for which the table has room; let it grow if need be."""
        arguments = (state, hinges, changes, room)
        while True:
            result = kernel(*arguments, self._table, self._scratch, *results)
            if result != TABLE_FULL:
                return result
            self._table = self._kernels.double_table(self._table)


def gap_between_cells(chain: Chain, module_size: float) -> float:
    """Return the gap between modules in neighbouring cells, pitches."""
    return 2.0 * chain.module.inner_radius * (1.0 - module_size)
