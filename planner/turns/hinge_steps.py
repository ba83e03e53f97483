"""Hinge steps: states of a chain whose hinges turn in steps, and the search for turns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.module import Module
from foldback.planner.core import MIN_TURN_SIZE, SIZE_TOLERANCE, JointTurns
from foldback.planner.core.structures import Levels, TurningChain, TurnSearch, TurnTable
from foldback.planner.errors import InputError

FULL_SIZE: Final = 1.0 - SIZE_TOLERANCE
"""Size that counts as full size: modules that touch are free, and so are those of which a file
states the corners to a few digits."""
MAX_LEVEL: Final = 127
"""Maximum number of steps of a hinge, either way."""
STEP_TOLERANCE_RAD: Final = 1e-3
"""Largest distance of an angle from a whole number of steps; files may give a few digits."""
DEPTH_WEIGHT: Final = 0.2
"""Weight of a turn made in the score of a state; one that is left counts 1."""
NEAR_WEIGHT: Final = 0.5
"""Weight of a pair of modules near each other in the score of a state."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StateSearch:
    """Result of a search for turns from one state to another.

    Attributes:
        reached: True if turns lead to the goal.
        exhausted: True if every state that can be reached was tried.
        way: (T + 1, J) states to the goal, or to the one with the fewest turns left.
        states: (S, J) all states if every one was tried, else none.
        count: Number of states.
        tried: Number of turns, and of motions of several hinges, that were tried.
        work: Number of corners that were projected on axes to compute sizes.
        size: Size of the modules at which the turns of the way are free. If it is smaller than the
            first one, every state that can be reached at any larger size was tried.
        next_size: Largest size of a turn that was not free; 0 for none.
    """

    reached: bool
    exhausted: bool
    way: Levels
    states: Levels
    count: int
    tried: int
    work: int
    size: float
    next_size: float


class HingeSteps:
    """States of a chain, or of some modules of it, whose hinges turn in steps.

    A state has one level for each hinge: its angle in steps, from 0 to one less than a full turn
    where the hinge turns freely.

    Args:
        module: The kind of module; each joint has a step.
        modules: Number of modules.
        first: Number of the first one in its chain.
        wraps: False if an angle and the same one after a full turn are two states.

    Raises:
        InputError: ``no-steps`` if a joint has no step.
    """

    def __init__(self, module: Module, modules: int, *, first: int = 0, wraps: bool = True) -> None:
        self.module = module
        self.modules = modules
        self.first = first
        chain = turning_chain(module, modules, first=first)
        self._chain = chain if wraps else chain._replace(period=np.zeros_like(chain.period))
        self._turns = JointTurns(self._chain)

    @property
    def step_rad(self) -> Array:
        """(J,) angle of a step of each hinge."""
        return self._chain.steps

    def levels(self, angles_rad: Array) -> Levels:
        """Return the (J,) levels of hinge angles.

        Raises:
            InputError: ``between-steps`` for an angle that is not a whole number of steps.
        """
        exact = np.asarray(angles_rad, dtype=np.float64) / self._chain.steps
        levels = np.rint(exact).astype(np.int64)
        off = np.abs(exact - levels) * self._chain.steps > STEP_TOLERANCE_RAD
        if off.any():
            hinge = int(np.flatnonzero(off)[0])
            raise InputError(
                "between-steps",
                "got an angle of {degrees}° at hinge {hinge}, expected a multiple of {step}°, the "
                "step of this module's joints.",
                degrees=round(float(np.rad2deg(angles_rad[hinge])), 3),
                hinge=hinge + 1,
                step=round(float(np.rad2deg(self._chain.steps[hinge])), 3),
            )
        return self.normal(levels)

    def normal(self, levels: Ints) -> Levels:
        """Return (…, J) levels without full turns."""
        period = self._chain.period
        return np.where(period > 0, levels % np.maximum(period, 1), levels).astype(np.int8)

    def angles(self, way: Levels) -> Array:
        """Return the (T + 1, J) angles on a way, of which the last state has the smallest angles.

        Each hinge turns by one step at most from one state to the next, also from the last level of
        a full turn to the first one.
        """
        period = self._chain.period
        change = np.diff(way.astype(np.int64), axis=0)
        change = np.where(period > 0, (change + 1) % np.maximum(period, 1) - 1, change)
        last = way[-1].astype(np.int64)
        last = np.where((period > 0) & (2 * last > period), last - period, last)
        before = np.cumsum(change[::-1], axis=0)[::-1]
        return self._chain.steps * np.concatenate([last - before, last[None]])

    def resting_size(self, state: Levels) -> tuple[float, int, int]:
        """Return the largest size at which no two modules meet in a state, and these modules."""
        return self._turns.resting_size(state)

    def turn_size(self, state: Levels, hinge: int, change: int) -> tuple[float, int, int, float]:
        """Return the size of a turn by ±1 step, the two modules that limit it, and the place."""
        return self._turns.turn_size(state, hinge, change)

    def motion_size(self, before: Levels, hinges: Ints, changes: Ints) -> float:
        """Return the size of turns of several hinges by ±1 step at the same time."""
        return self._turns.motion_size(before, hinges, changes)[0]

    def clear_turns(self, start: Levels, hinges: Ints, changes: Ints, *, size: float) -> int:
        """Return the number of turns before the first that is not free at a size.

        Args:
            start: (J,) levels before the first turn.
            hinges, changes: (T,) hinge of each turn, and −1 or 1.
            size: Size of the modules.
        """
        state = start.copy()
        turns = zip(hinges.tolist(), changes.tolist(), strict=True)
        for count, (hinge, change) in enumerate(turns):
            if self._turns.turn_size(state, hinge, change)[0] < size:
                return count
            state[hinge] += change
        return len(hinges)

    def way_size(self, way: Levels) -> float:
        """Return the size at which all turns between (T + 1, J) states are free."""
        levels = np.rint(self.angles(way) / self._chain.steps).astype(np.int64)
        sizes = [1.0]
        for before, change in zip(way[:-1], np.diff(levels, axis=0), strict=True):
            hinges = np.flatnonzero(change)
            if len(hinges) == 1:
                hinge = int(hinges[0])
                sizes.append(self._turns.turn_size(before, hinge, int(change[hinge]))[0])
            elif len(hinges) > 1:
                sizes.append(self._turns.motion_size(before, hinges, change[hinges])[0])
        return min(sizes)

    def table(self, states: Levels, size: float) -> TurnTable:
        """Return what each turn of each of (S, J) states leads to at a size."""
        return self._turns.turn_table(states, size)

    def search(
        self,
        start: Levels,
        goal: Levels,
        *,
        size: float = 1.0,
        min_size: float | None = None,
        together: int = 1,
        max_states: int,
        max_motions: int = 100_000,
        max_work: int = 0,
        depth_weight: float = DEPTH_WEIGHT,
        seed: int = 0,
    ) -> StateSearch:
        """Search for turns from a state to a goal.

        Args:
            start, goal: (J,) levels.
            size: Size of the modules, at most 1.
            min_size: Size to which they may be made smaller where no turn leads on.
            together: Maximum number of hinges that turn at once where no single one leads on.
            max_states: Number of states after which the search stops.
            max_motions: Number of motions of several hinges after which it stops.
            max_work: Work of computing sizes after which it stops; 0 for no limit.
            depth_weight: Weight of a turn made in the score of a state; with 1 or less and no other
                weight, the first way is a shortest one.
            seed: Seed of the order of equal states.
        """
        smallest = size if min_size is None else max(min_size, MIN_TURN_SIZE)
        limits = TurnSearch(
            size=size,
            min_size=smallest,
            depth_weight=depth_weight,
            near_weight=NEAR_WEIGHT,
            together=together,
            max_states=max_states,
            max_motions=max_motions,
            max_work=max_work,
            seed=seed,
        )
        search = self._turns.search(start, goal, limits)
        return StateSearch(
            reached=search.outcome == 0,
            exhausted=search.outcome == 1,
            way=search.way,
            states=search.states,
            count=search.state_count,
            tried=search.tried + search.motions,
            work=search.work,
            size=search.size,
            next_size=search.next_size,
        )


def turning_chain(module: Module, modules: int, *, first: int = 0) -> TurningChain:
    """Return a chain as kernels take it.

    Args:
        module: The kind of module.
        modules: Number of modules.
        first: Number of the first one in its chain.

    Raises:
        InputError: ``no-steps`` if a joint has no step.
    """
    links = [module.link(first + k) for k in range(modules - 1)]
    jointed = [first + k >= module.rigid_links for k in range(modules - 1)]
    per_joint = module.hinges_per_joint
    numbers = [k for k, has_hinges in enumerate(jointed) if has_hinges]
    steps: list[float] = []
    for k in numbers:
        step = module.piece(first + k).step_rad
        if step is None:
            raise InputError(
                "no-steps",
                f'the joints of the module "{module.name}" have no step, expected one such as 90 '
                "degrees; add step_deg to its joints.",
            )
        steps.extend([step] * per_joint)
    step_rad = np.array(steps)
    period = len(module.pattern)
    ranges = np.array([module.ranges_rad[(first + k) % period] for k in numbers]).reshape(-1, 2)
    is_free = np.isinf(ranges).all(axis=1)
    turn = 2.0 * np.pi / step_rad
    limited = np.clip(ranges / step_rad[:, None], -MAX_LEVEL, MAX_LEVEL)
    levels = np.stack([np.ceil(limited[:, 0] - 1e-6), np.floor(limited[:, 1] + 1e-6)], axis=1)
    return TurningChain(
        anchor=np.array([link.anchor for link in links]),
        axes=np.array([links[k].axes for k in numbers]).reshape(-1, 3),
        turn=np.array([link.turn for link in links]),
        offset=np.array([link.offset for link in links]),
        hinge_of=per_joint * np.concatenate([[0], np.cumsum(jointed)]).astype(np.int64),
        steps=step_rad,
        levels=levels.astype(np.int64),
        period=np.where(is_free & (np.abs(turn - np.rint(turn)) < 1e-6), np.rint(turn), 0).astype(
            np.int64
        ),
        hull=module.hull._replace(first=first % period),
        apart=module.apart,
    )
