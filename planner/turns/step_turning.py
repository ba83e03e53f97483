"""Turns of chains whose hinges turn in steps, for modules of any kind: a sequence of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.core.structures import Levels
from foldback.planner.turns.hinge_steps import HingeSteps

ROOM_SHARE: Final = 0.9
"""Distance that modules keep in a merged step, as a fraction of the one that they keep in single
turns."""
MAX_STATES: Final = 4_000
"""Maximum number of states of a search; 60 figures of 24 prisms need 168 to 1273."""
MAX_MOTIONS: Final = 5_000
"""Maximum number of motions of several hinges that a search tries."""
SIZE_RESOLUTION: Final = 0.01
"""Difference of two sizes, fractions of the full one, between which none is tried."""
MAX_WORK: Final = 600_000_000
"""Maximum number of corners that searches for turns project on axes unless turns were asked for:
about a second. 60 figures of 24 prisms need 224 million at most:
docs/decisions/0066-turns-by-steps.md."""
MAX_TOGETHER: Final = 3
"""Maximum number of hinges that a search turns at once where no single one leads on."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Way:
    """Turns from a state to straight, or as near as a search came.

    Attributes:
        reached: True if they lead to straight.
        states: (T + 1, J) states.
        size: Size of the modules at which all turns are free.
        expanded: Number of states that were tried.
        work: Number of corners that were projected on axes to compute sizes.
    """

    reached: bool
    states: Levels
    size: float
    expanded: int
    work: int


def roomiest_way(
    steps: HingeSteps,
    start: Levels,
    *,
    min_size: float,
    together: bool,
    seed: int,
    max_work: int = 0,
) -> Way:
    """Return turns from a state to straight that are free for modules as large as possible.

    Full size is tried first, then the smallest size, then sizes between.

    Args:
        steps: The states.
        start: (J,) levels.
        min_size: Smallest size of the modules.
        together: True if several hinges may turn at once where no single one leads on.
        seed: Seed of the searches.
        max_work: Work of computing sizes after which the searches stop; 0 for no limit.
    """
    expanded = work = 0
    best = Way(reached=False, states=start[None], size=min_size, expanded=0, work=0)

    def search(size: float, count: int = 1) -> Way:
        nonlocal expanded, work
        if 0 < max_work <= work:
            return replace(best, reached=False, expanded=expanded, work=work)
        result = steps.search(
            start,
            np.zeros_like(start),
            size=size,
            together=count,
            max_states=MAX_STATES,
            max_motions=MAX_MOTIONS,
            max_work=max(max_work - work, 0),
            seed=seed,
        )
        expanded += result.count
        work += result.work
        free = min(1.0, steps.way_size(result.way)) if result.reached else size
        return Way(
            reached=result.reached,
            states=result.way,
            size=free,
            expanded=expanded,
            work=work,
        )

    for count in (1, MAX_TOGETHER) if together else (1,):
        widest, high = search(1.0, count), 1.0
        if widest.reached:
            return widest
        best = search(min_size, count)
        while best.reached and high - best.size > SIZE_RESOLUTION:
            size = 0.5 * (best.size + high)
            way = search(size, count)
            if way.reached:
                best = way
            else:
                high = size
        if best.reached:
            break
    return replace(best, expanded=expanded, work=work)


class StepTurning:
    """Turns of a chain by the hinges' own steps, with the most room that there is.

    A state has one level for each hinge: its angle in steps.

    Args:
        chain: The chain; its folded angles are whole steps.
        module_size: Module size as a fraction of the pitch.

    Attributes:
        size: Module size as a fraction of the pitch.
        step_rad: (J,) angle of a step of each hinge.
        folded: (J,) levels of the folded chain.
    """

    def __init__(self, chain: Chain, module_size: float) -> None:
        self.size = module_size
        self._inner = 2.0 * chain.module.inner_radius
        self._steps = HingeSteps(chain.module, len(chain), wraps=False)
        # Where no hinge turns freely, both are the same states.
        wraps = bool(np.isinf(chain.ranges_rad).any())
        self._turning = HingeSteps(chain.module, len(chain)) if wraps else self._steps
        self.step_rad: Array = self._steps.step_rad
        self.folded: Levels = self._steps.levels(chain.folded_rad)

    def way(self, *, together: bool, seed: int, max_work: int = 0) -> Way:
        """Return turns from folded to straight, with the most room.

        Args:
            together: True if several hinges may turn at once where no single one leads on.
            seed: Seed of the searches.
            max_work: Work of computing sizes after which they stop; 0 for no limit.
        """
        left = max_work
        for steps in (self._turning, self._steps):
            way = roomiest_way(
                steps,
                steps.normal(self.folded.astype(np.int64)),
                min_size=self.size,
                together=together,
                seed=seed,
                max_work=left,
            )
            levels = np.rint(steps.angles(way.states) / self.step_rad).astype(np.int8)
            if way.reached and np.array_equal(levels[0], self.folded):
                return replace(way, states=levels)
            left -= way.work
            if steps is self._steps or (max_work and left <= 0):
                break
        return replace(way, reached=False, states=levels)

    def room(self, size: float) -> float:
        """Return a distance that modules keep where turns are free at a size, pitches."""
        return ROOM_SHARE * self._inner * (size - self.size)

    def clear_turns(self, start: Levels, hinges: Ints, changes: Ints, *, room: float) -> int:
        """Return the number of turns before the first in which modules come nearer than ``room``.

        Two convex modules that are free at a size keep, when they are made smaller about their
        centres, what the balls within them lose.

        Args:
            start: (J,) levels before the first turn.
            hinges, changes: (T,) hinge of each turn, and −1 or 1.
            room: Distance that modules must keep, pitches.
        """
        size = min(1.0, self.size + room / self._inner)
        return self._steps.clear_turns(start, hinges, changes, size=size - 1e-7)


def turns_in_steps(chain: Chain) -> bool:
    """Return True if a chain's hinges turn in steps, and its folded angles are whole steps."""
    if not chain.module.has_steps:
        return False
    steps = chain.folded_rad / HingeSteps(chain.module, len(chain)).step_rad
    return bool((np.abs(steps - np.rint(steps)) < 1e-4).all())


def unwound(chain: Chain, *, module_size: float, seed: int) -> Chain:
    """Return a chain whose freely turning hinges are bent as turns from straight leave them.

    A half turn to the left is the same figure as one to the right, but another motion; which one
    leads there is known after a search. Other chains are returned as they are.

    Args:
        chain: The chain.
        module_size: Module size as a fraction of the pitch.
        seed: Seed of the search.
    """
    if not np.isinf(chain.ranges_rad).any() or not turns_in_steps(chain):
        return chain
    steps = HingeSteps(chain.module, len(chain))
    figure = steps.levels(chain.folded_rad)
    way = roomiest_way(
        steps, figure, min_size=module_size, together=True, seed=seed, max_work=MAX_WORK
    )
    if not way.reached:
        return chain
    folded = steps.angles(way.states)[0]
    folded.setflags(write=False)
    return replace(chain, folded_rad=folded)
