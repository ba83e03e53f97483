"""Portfolio: what is tried when an explosion sticks, or its plan is refused or may be bettered.

What comes next is decided by what was tried so far and by why it failed, and by nothing else: the
same fold always takes the same way.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

from planner.explosion.diagnosis import Diagnosis
from planner.explosion.strategies import others_for, strategies_for
from planner.pipeline.attempt import MOST, Attempt, Candidates, Reason, Try
from planner.pipeline.improvements import Improvements
from planner.pipeline.preference import COMPUTING
from planner.pipeline.request import LARGEST_SEED, Request
from planner.robot import MOST_ANGLES, WAYS
from planner.simulation.parameters import BASELINE, ExplosionParameters

MOST_SEEDS: Final = 3
"""Seeds that one fold tries."""
Change = Literal["path", "strategy", "end", "forces", "seed"]
CHANGES: Final[dict[Reason, tuple[Change, ...]]] = {
    "knot": ("path", "strategy"),
    "buried": ("end", "strategy", "path", "seed"),
    "contacts": ("forces", "strategy", "path", "seed"),
    "joints": ("path", "strategy", "end", "seed"),
    "broken": ("strategy", "path", "seed"),
    "limit": ("strategy", "path"),
    "refused": ("path", "seed", "strategy", "forces"),
    "stopped": ("strategy", "path"),
}
"""What is changed for each reason, in this order: end of the path, forces, strategy, path, seed."""
DENSER: Final = 4
"""Factor of the frames that a plan may get when it is smoothed, peeled ones most. Measured."""
LIKELY: Final[dict[str, Reason]] = {"peel": "buried"}
"""The usual reason why a strategy sticks; of those not named it is ``joints``."""

ONE_ENDED: Final = ("peel", "one-by-one")
"""Strategies that begin at one end of the chain, and so may begin at the other."""
SET: Final = ("one-by-one",)
"""Strategies on whose result forces and seeds have no influence."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Portfolio:
    """What there is to choose from.

    Attributes:
        strategies: For each path, the strategies that it may have, the best first.
        seed: What the fold starts from.
        two_ended: Whether a path may be taken from its other end.
        forces: Whether the forces may be others than asked for.
        seeds: How many of them may be tried.
        improvements: What may be tried after a verified plan; None when that is the end.
        retries_refused: Whether anything follows a plan that its certificate refuses.
    """

    strategies: tuple[tuple[str, ...], ...]
    seed: int
    two_ended: bool = False
    forces: bool = False
    seeds: int = MOST_SEEDS
    improvements: Improvements | None = None
    retries_refused: bool = True

    @classmethod
    def of(cls, request: Request, candidates: Candidates) -> Portfolio:
        """Return what may be tried of a fold."""
        if request.smooth:
            return cls(strategies=(WAYS,), seed=request.seed, seeds=1)
        parameters, chains = request.parameters(), candidates.chains
        ours = isinstance(parameters.explosion, ExplosionParameters)
        improvements = None
        if request.prefer != COMPUTING:
            hinges = len(chains[0].folded_rad)
            improvements = Improvements(
                prefer=request.prefer,
                strategies=tuple(
                    others_for(chain, parameters, refolds=request.refold) for chain in chains
                ),
                modules=len(chains[0]),
                most_frames=0 if request.refold else MOST_ANGLES // (DENSER * max(hinges, 1)),
            )
        return cls(
            strategies=tuple(
                strategies_for(chain, parameters, refolds=request.refold) for chain in chains
            ),
            seed=request.seed,
            two_ended=candidates.two_ended,
            forces=ours,
            seeds=MOST_SEEDS if ours else 1,  # as published there is nothing that a seed changes
            improvements=improvements,
            retries_refused=ours and parameters.strategy != BASELINE,
        )

    def after(self, tried: Sequence[Attempt]) -> Try | None:
        """What is tried after so many attempts; None when enough was tried.

        Args:
            tried: The attempts so far.
        """
        if not tried:
            return Try(0, self.seed, self.strategies[0][0])
        if any(attempt.verified for attempt in tried):
            return None if self.improvements is None else self.improvements.after(tried)
        if sum(attempt.finer == 1 for attempt in tried) >= MOST:
            return None
        done = {attempt.todo for attempt in tried}
        last = tried[-1]
        for change in CHANGES[last.why]:
            for other in self._changed(change, last.todo):
                if other not in done:
                    return other
        return None

    def ahead(
        self,
        tried: Sequence[Attempt],
        here: Try,
        known: Mapping[Try, Attempt] | None = None,
    ) -> list[Try]:
        """What may come after a try that is being made, the likeliest first.

        A strategy likely fails as it did before. What is known to come straight may be refused.
        A smoothing is never begun early.

        Args:
            tried: The attempts before it.
            here: What is being made.
            known: What came of others that were made already.
        """
        known = known or {}
        seen: dict[str, Reason] = {attempt.todo.strategy: attempt.why for attempt in tried}
        found: dict[Try, None] = {}
        for reason in (None, *CHANGES):
            todo: Try | None = here
            failed = list(tried)
            while todo is not None:
                likely = seen.get(todo.strategy) or LIKELY.get(todo.strategy, "joints")
                failed.append(known.get(todo) or _failed(todo, reason or likely))
                todo = self.after(failed)
                if todo is not None and todo.smooths is not None:
                    todo = None  # of which plan is known only when all explosions are over
                if todo is not None:
                    found[todo] = None
        return list(found)

    def _changed(self, change: Change, here: Try) -> Iterator[Try]:
        """What there is by one change, the nearest first."""
        if change == "path":
            for candidate, known in enumerate(self.strategies):
                strategy = here.strategy if here.strategy in known else known[0]
                yield replace(here, candidate=candidate, strategy=strategy)
        elif change == "strategy":
            for strategy in self.strategies[here.candidate]:
                yield replace(here, strategy=strategy)
        elif change == "end":
            if self.two_ended and here.strategy in ONE_ENDED:
                yield replace(here, other_end=not here.other_end)
        elif change == "forces":
            if self.forces and here.strategy not in SET:
                yield replace(here, gentle=True)
        elif here.strategy not in SET:
            for k in range(self.seeds):
                yield replace(here, seed=(self.seed + k) % (LARGEST_SEED + 1))


def _failed(todo: Try, reason: Reason) -> Attempt:
    """An attempt that fails for a reason."""
    if reason == "refused":
        return Attempt(todo=todo, status="straight")
    return Attempt(todo=todo, status="stalled", diagnosis=Diagnosis(kind=reason, modules=()))
