"""Retry policy: the attempt after an explosion that stalls, or whose plan is refused or improved.

The next attempt depends on the attempts so far and on the reasons why they failed, and on nothing
else: the same fold always takes the same way.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

from foldback.planner.explosion.diagnosis import Diagnosis
from foldback.planner.explosion.strategies import (
    alternative_strategies,
    ranked_strategies,
    takes_turns,
)
from foldback.planner.parameters.explosion import ExplosionParameters
from foldback.planner.parameters.parameters import AUTO, BASELINE, TURN_STRATEGIES, TURNS
from foldback.planner.pipeline.attempt import (
    MAX_EXPLOSIONS,
    Attempt,
    AttemptSpec,
    Candidates,
    Cause,
)
from foldback.planner.pipeline.improvements import Improvements
from foldback.planner.pipeline.preference import CALM, COMPUTING
from foldback.planner.pipeline.request import MAX_SEED, FoldRequest
from foldback.planner.smoothing import MAX_SMOOTHED_ANGLES, SMOOTHING_WAYS

Change = Literal["plain", "path", "strategy", "end", "forces", "seed"]
MAX_SEEDS: Final = 3
"""Maximum number of seeds of the random forces with which one fold tries to explode its chain."""
FALLBACKS: Final[dict[Cause, tuple[Change, ...]]] = {
    "knot": ("plain", "path", "strategy"),
    "buried": ("plain", "end", "strategy", "path", "seed"),
    "contacts": ("plain", "forces", "strategy", "path", "seed"),
    "joints": ("plain", "path", "strategy", "end", "seed"),
    "broken": ("plain", "strategy", "path", "seed"),
    "limit": ("plain", "strategy", "path"),
    "refused": ("plain", "path", "seed", "strategy", "forces"),
    "stopped": ("strategy", "path"),
    "blocked": ("path",),
}
"""What a fold changes for its next attempt, tried from left to right, by the reason why the last
explosion failed (for example ``knot``: the chain is knotted). ``plain``, after a calm explosion,
comes first, so that no fold is lost by calmness. Measured."""
DEFAULT_REASON: Final[dict[str, Cause]] = {"peel": "buried"}
"""Assumed reason of a failed explosion by the strategy that stalled, if the explosion reports none:
the most frequent one. All other strategies assume ``joints``."""

DIRECTIONAL_STRATEGIES: Final = ("peel",)
"""Explosion strategies that release a chain from one of its ends; to begin at the other end is one
of the changes that a fold tries after a failure."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RetryPolicy:
    """Paths, strategies and seeds that one fold may try.

    Attributes:
        strategies: Strategies of each path, the best first.
        seed: First seed of the fold.
        two_ended: True if a path may be taken from its other end.
        forces: True if the forces may be others than asked for.
        seeds: Number of seeds that may be tried.
        calm: True if explosions of all modules are calm at first.
        turns: True if turns with the most room are looked for before all explosions.
        improvements: Attempts after a verified plan; None when that is the end.
        retries_refused: True if attempts follow a plan that its certificate refuses.
    """

    strategies: tuple[tuple[str, ...], ...]
    seed: int
    two_ended: bool = False
    forces: bool = False
    seeds: int = MAX_SEEDS
    calm: bool = False
    turns: bool = False
    improvements: Improvements | None = None
    retries_refused: bool = True

    @classmethod
    def of(cls, request: FoldRequest, candidates: Candidates) -> RetryPolicy:
        """Return the policy of a fold."""
        if request.smooth:
            return cls(strategies=(SMOOTHING_WAYS,), seed=request.seed, seeds=1)
        chains = candidates.chains
        parameters = request.parameters(chains[0].module)
        has_forces = isinstance(parameters.explosion, ExplosionParameters)
        improvements = None
        if request.prefer != COMPUTING:
            hinges = len(chains[0].folded_rad)
            improvements = Improvements(
                prefer=request.prefer,
                strategies=tuple(
                    alternative_strategies(
                        chain, parameters, refolds=request.refold, turns=request.prefer == CALM
                    )
                    for chain in chains
                ),
                modules=len(chains[0]),
                max_frames=0
                if request.refold
                # measured: plans of peeled chains need most
                else MAX_SMOOTHED_ANGLES // (4 * max(hinges, 1)),
            )
        return cls(
            strategies=tuple(
                ranked_strategies(chain, parameters, refolds=request.refold) for chain in chains
            ),
            seed=request.seed,
            two_ended=candidates.two_ended,
            forces=has_forces,
            seeds=MAX_SEEDS
            if has_forces
            else 1,  # as published there is nothing that a seed changes
            calm=has_forces and parameters.strategy == AUTO and parameters.world != "table",
            turns=request.prefer == COMPUTING
            and takes_turns(chains[0], parameters, refolds=request.refold),
            improvements=improvements,
            retries_refused=has_forces and parameters.strategy != BASELINE,
        )

    def next_attempt(self, attempts: Sequence[Attempt]) -> AttemptSpec | None:
        """Return the next attempt; None when enough was tried.

        Args:
            attempts: The attempts so far.
        """
        if self.turns:
            if not attempts:
                return AttemptSpec(0, self.seed, TURNS, roomy=True)
            # After a search in vain, the fold goes on as if there had been none.
            attempts = [
                attempt for attempt in attempts if attempt.verified or not attempt.spec.roomy
            ]
        if not attempts:
            return AttemptSpec(0, self.seed, self.strategies[0][0])
        if any(attempt.verified for attempt in attempts):
            return None if self.improvements is None else self.improvements.next_attempt(attempts)
        if sum(not attempt.repeats for attempt in attempts) >= MAX_EXPLOSIONS:
            return None
        done = {attempt.spec for attempt in attempts}
        last = attempts[-1]
        plain = any(spec.plain for spec in done)
        for change in FALLBACKS[last.why]:
            for variant in self._changed(change, last.spec):
                if plain and variant.strategy == "simultaneous":
                    variant = replace(variant, plain=True)
                if variant not in done:
                    return variant
        return None

    def lookahead(
        self,
        attempts: Sequence[Attempt],
        current: AttemptSpec,
        finished: Mapping[AttemptSpec, Attempt] | None = None,
    ) -> list[AttemptSpec]:
        """Return what may come after an attempt that is being computed, the likeliest first.

        A strategy likely fails as it did before. What is known to come straight may be refused.
        A smoothing is never begun early.

        Args:
            attempts: The attempts before it.
            current: Current attempt.
            finished: Results of finished attempts.
        """
        finished = finished or {}
        causes: dict[str, Cause] = {attempt.spec.strategy: attempt.why for attempt in attempts}
        specs: dict[AttemptSpec, None] = {}
        for reason in (None, *FALLBACKS):
            spec: AttemptSpec | None = current
            failed = list(attempts)
            while spec is not None:
                likely = causes.get(spec.strategy) or DEFAULT_REASON.get(spec.strategy, "joints")
                failed.append(finished.get(spec) or _failed(spec, reason or likely))
                spec = self.next_attempt(failed)
                if spec is not None and spec.smooths is not None:
                    spec = None  # of which plan is known only when all explosions are over
                if spec is not None:
                    specs[spec] = None
        return list(specs)

    def _changed(self, change: Change, current: AttemptSpec) -> Iterator[AttemptSpec]:
        """Yield the specifications by one change, the nearest first."""
        if change == "plain":
            if self.calm and current.strategy == "simultaneous":
                yield replace(current, plain=True)
        elif change == "path":
            for candidate, tried_strategies in enumerate(self.strategies):
                strategy = (
                    current.strategy
                    if current.strategy in tried_strategies
                    else tried_strategies[0]
                )
                yield replace(current.with_strategy(strategy), candidate=candidate)
        elif change == "strategy":
            for strategy in self.strategies[current.candidate]:
                yield current.with_strategy(strategy)
        elif change == "end":
            if self.two_ended and current.strategy in DIRECTIONAL_STRATEGIES:
                yield replace(current, other_end=not current.other_end)
        elif change == "forces":
            if self.forces and current.strategy not in TURN_STRATEGIES:  # without forces
                yield replace(current, gentle=True)
        else:
            for k in range(self.seeds):
                yield replace(current, seed=(self.seed + k) % (MAX_SEED + 1))


def _failed(spec: AttemptSpec, cause: Cause) -> Attempt:
    """Return an attempt that fails for a reason."""
    if cause == "refused":
        return Attempt(spec=spec, status="straight")
    return Attempt(spec=spec, status="stalled", diagnosis=Diagnosis(kind=cause, modules=()))
