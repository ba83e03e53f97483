"""Deciding: the searches behind a verdict on a figure, cheapest first."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from typing import Final

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.module import Module
from foldback.planner.core import SIZE_TOLERANCE
from foldback.planner.core.structures import Levels
from foldback.planner.errors import InputError
from foldback.planner.reachability.verdict import Exhaustion, Sequence, Verdict
from foldback.planner.reachability.verdict_figures import VerdictKind
from foldback.planner.turns.hinge_steps import FULL_SIZE, HingeSteps, StateSearch

MIN_SIZE: Final = 0.5
"""Size of the modules below which no turns are searched for."""
MAX_STATES: Final = 20_000
"""Maximum number of states of a search for turns of the whole chain. Of 60 figures of the snake,
those with turns at full size need 204 to 1273."""
MAX_PART_STATES: Final = 3_000
"""Maximum number of states of a search for turns of a part of the chain."""
MAX_MOTIONS: Final = 20_000
"""Maximum number of motions of several joints at once that are tried."""
SIZE_STEP: Final = 0.01
"""Amount by which the size is reduced where a search ends without a result."""


class Decider:
    """Decides whether turns lead from a goal to a figure.

    Args:
        module: The kind of module.
        figure_rad: (J,) hinge angles of the figure.
        goal_rad: (J,) hinge angles of the goal; straight if None.
        seed: Seed of the searches.

    Raises:
        InputError: ``no-steps``, ``between-steps``, or ``overlap`` if modules overlap.
    """

    def __init__(
        self, module: Module, figure_rad: Array, goal_rad: Array | None = None, *, seed: int = 0
    ) -> None:
        figure_rad = np.asarray(figure_rad, dtype=np.float64).reshape(-1)
        self._module = module
        self._seed = seed
        self._modules = module.module_count(len(figure_rad))
        self._whole = _hinge_steps(module, self._modules, 0)
        self._figure = self._whole.levels(figure_rad)
        goal = np.zeros(len(figure_rad)) if goal_rad is None else goal_rad
        self._goal = self._whole.levels(goal)
        self._states = self._tried = 0
        for state in (self._figure, self._goal):
            check_overlap(self._whole, state)

    def verdict(self, *, sizes: bool = True) -> Verdict:
        """Return the verdict.

        Args:
            sizes: Also search for the largest size where full size does not do.
        """
        search = self._to_goal()
        if search.reached:
            return self._verdict("one-joint", at_full_size=self._sequence(search))
        exhaustion, limit = self._exhaustion(search)
        kind: VerdictKind = "not-found" if exhaustion is None else "no-sequence"
        together = self._several_at_once(exhaustion)
        smaller, is_largest = self._smaller(limit) if sizes else (None, False)
        if together is not None:
            kind = "several-joints"
        elif smaller is not None:
            kind = "smaller-modules"
        return self._verdict(
            kind,
            at_full_size=together,
            smaller=smaller,
            is_largest=is_largest,
            exhaustion=exhaustion,
        )

    def _verdict(
        self,
        kind: VerdictKind,
        *,
        at_full_size: Sequence | None = None,
        smaller: Sequence | None = None,
        is_largest: bool = True,
        exhaustion: Exhaustion | None = None,
    ) -> Verdict:
        return Verdict(
            kind=kind,
            figure=self._figure,
            goal=self._goal,
            modules=self._modules,
            at_full_size=at_full_size,
            smaller=smaller,
            is_largest=is_largest,
            exhaustion=exhaustion,
            states=self._states,
            tried=self._tried,
        )

    def _search(
        self,
        steps: HingeSteps,
        start: Levels,
        goal: Levels,
        *,
        size: float = FULL_SIZE,
        min_size: float | None = None,
        together: int = 1,
        max_states: int,
    ) -> StateSearch:
        """Search, and count what was tried."""
        search = steps.search(
            start,
            goal,
            size=size,
            min_size=min_size,
            together=together,
            max_states=max_states,
            max_motions=MAX_MOTIONS,
            seed=self._seed,
        )
        self._states += search.count
        self._tried += search.tried
        return search

    def _to_goal(self, *, size: float = FULL_SIZE, min_size: float | None = None) -> StateSearch:
        """Search for single turns from the figure to the goal: directly, or by way of straight."""

        def search(start: Levels, goal: Levels) -> StateSearch:
            return self._search(
                self._whole, start, goal, size=size, min_size=min_size, max_states=MAX_STATES
            )

        direct = search(self._figure, self._goal)
        if direct.reached or not self._goal.any():
            return direct
        halves = [search(state, np.zeros_like(state)) for state in (self._figure, self._goal)]
        if not all(half.reached for half in halves):
            return direct
        return replace(
            direct,
            reached=True,
            exhausted=False,
            way=np.concatenate([halves[0].way, halves[1].way[-2::-1]]),
            size=min(half.size for half in halves),
        )

    def _sequence(self, search: StateSearch) -> Sequence:
        """Return the turns of a search from the figure, the other way round."""
        return Sequence(
            rest_angles_rad=self._whole.angles(search.way)[::-1].copy(),
            size=self._whole.way_size(search.way),
        )

    def _parts(self) -> Iterator[tuple[int, HingeSteps, Levels, Levels]]:
        """Yield the parts of the chain, short ones first: first module, steps, figure and goal."""
        module, per_joint = self._module, self._module.hinges_per_joint
        for modules in range(3, self._modules):
            for first in range(module.rigid_links, self._modules - modules + 1):
                begin = per_joint * (first - module.rigid_links)
                hinges = slice(begin, begin + per_joint * (modules - 1))
                figure, goal = self._figure[hinges].copy(), self._goal[hinges].copy()
                if not np.array_equal(figure, goal):
                    place = first % len(module.pattern)
                    yield first, _hinge_steps(module, modules, place), figure, goal

    def _exhaustion(self, whole: StateSearch) -> tuple[Exhaustion | None, float]:
        """Return a proof that single turns do not lead there, and the largest size that may do.

        Args:
            whole: Search for turns of the whole chain at full size.
        """
        for first, steps, figure, goal in self._parts():
            search = self._search(steps, figure, goal, max_states=MAX_PART_STATES)
            if search.exhausted:
                smaller = self._search(
                    steps, figure, goal, min_size=MIN_SIZE, max_states=MAX_PART_STATES
                )
                limit = smaller.size if smaller.reached else search.next_size
                return _exhaustion_of(search, first, steps.modules, goal), limit
        if whole.exhausted:
            return _exhaustion_of(whole, 0, self._modules, self._goal), whole.next_size
        return None, 1.0

    def _several_at_once(self, exhaustion: Exhaustion | None) -> Sequence | None:
        """Return turns at full size of which some are made at once; None if none was found."""
        if exhaustion is not None and exhaustion.modules < self._modules:
            place = exhaustion.first % len(self._module.pattern)
            part = self._search(
                _hinge_steps(self._module, exhaustion.modules, place),
                exhaustion.states[0],
                exhaustion.goal,
                together=3,
                max_states=MAX_PART_STATES,
            )
            if not part.reached:
                return None
        search = self._search(
            self._whole, self._figure, self._goal, together=3, max_states=MAX_STATES
        )
        return self._sequence(search) if search.reached else None

    def _smaller(self, limit: float) -> tuple[Sequence | None, bool]:
        """Return single turns for smaller modules, and whether their size is the largest one.

        Args:
            limit: Size above which there are no single turns.
        """
        size, is_largest = limit - 2.0 * SIZE_TOLERANCE, True
        while size >= MIN_SIZE:
            search = self._to_goal(size=size, min_size=MIN_SIZE)
            if search.reached and search.size < size:  # a shorter way, without the detours so far
                again = self._to_goal(size=search.size)
                search = again if again.reached else search
            if search.reached:
                return self._sequence(search), is_largest
            size, is_largest = min(search.size, size) - SIZE_STEP, False
        return None, False


def _exhaustion_of(search: StateSearch, first: int, modules: int, goal: Levels) -> Exhaustion:
    return Exhaustion(first=first, modules=modules, states=search.states, goal=goal)


def check_overlap(steps: HingeSteps, state: Levels) -> None:
    """Refuse a state in which modules overlap.

    Raises:
        InputError: ``overlap``, with the numbers of two such modules.
    """
    size, first, second = steps.resting_size(state)
    if size < FULL_SIZE:
        raise InputError(
            "overlap",
            "this figure cannot exist: its modules {modules} would lie in one another; check the "
            "angles of the joints between them.",
            where="modules {modules}",
            modules=[first, second],
        )


@lru_cache(maxsize=64)
def _hinge_steps(module: Module, modules: int, first: int) -> HingeSteps:
    """Return the states of a part of a chain; what is known of its turns is kept."""
    return HingeSteps(module, modules, first=first)
