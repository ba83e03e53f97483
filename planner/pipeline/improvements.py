"""Improvements: attempts after a verified plan, for one that suits a preference better.

The first verified plan is that of a fold without a wish: it costs least, and is what the others are
measured by. Then the other strategies let the same path go, the best of them lets other paths go,
and the best plans are smoothed, what came out best with several seeds: how long a fold takes
depends on the seed of an explosion by a hundredth, on that of a smoothing by a third.

What is tried depends on what came of the tries before and on expected costs, never on a clock: a
seed always takes the same way.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

from foldback.planner.parameters.parameters import TURNS
from foldback.planner.pathfinding.expected_duration import MAX_IMPROVING_S, smoothing_seconds
from foldback.planner.pipeline.attempt import MAX_EXPLOSIONS, Attempt, AttemptSpec
from foldback.planner.pipeline.preference import CALM, COMPUTING, Preference
from foldback.planner.pipeline.request import MAX_SEED
from foldback.planner.smoothing import SMOOTHED, SMOOTHING_WAYS, SOFTENED

SEEDS_PER_SMOOTHED_PLAN: Final = 3
"""Number of random seeds, the first one included, with which the smoothing (by random shortcuts)
that gave the best plan is repeated."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Improvements:
    """Attempts after a verified plan.

    Attributes:
        prefer: Requested preference.
        strategies: Possible strategies of each path, the most promising first.
        modules: Number of modules of the chain.
        max_frames: Frames of a plan that may be smoothed; 0 when none may.
    """

    prefer: Preference
    strategies: tuple[tuple[str, ...], ...]
    modules: int
    max_frames: int

    def next_attempt(self, attempts: Sequence[Attempt]) -> AttemptSpec | None:
        """Return the next attempt after one is verified; None when that is enough.

        Args:
            attempts: The attempts so far.
        """
        exploded = [attempt for attempt in attempts if attempt.spec.smooths is None]
        best = best_of(exploded, self.prefer)  # smoothings come after all explosions
        if self.prefer == COMPUTING or best is None:
            return None
        first = next(number for number, attempt in enumerate(attempts) if attempt.verified)
        since = {attempt.spec for attempt in attempts[first + 1 :]} - {attempts[first].spec}
        remaining_s = MAX_IMPROVING_S - sum(
            expected_seconds_of(spec, self.modules) for spec in since
        )
        done = {attempt.spec for attempt in attempts}
        for spec in self._ways(attempts, attempts[first].spec, exploded[best].spec):
            if spec not in done and expected_seconds_of(spec, self.modules) <= remaining_s:
                return spec
        return None

    def _ways(
        self, attempts: Sequence[Attempt], first: AttemptSpec, best: AttemptSpec
    ) -> Iterator[AttemptSpec]:
        """Yield all possible improvements, the most promising first."""
        explosions = {attempt.spec for attempt in attempts if attempt.spec.smooths is None}
        if len(explosions) < MAX_EXPLOSIONS:
            yield from self._explosions(first, best)
        yield from self._smoothings(attempts)

    def _explosions(self, first: AttemptSpec, best: AttemptSpec) -> Iterator[AttemptSpec]:
        """Other strategies for the path of the first verified plan, then the best on others."""
        for strategy in self.strategies[first.candidate]:
            yield first.with_strategy(strategy)
        for candidate, tried_strategies in enumerate(self.strategies):
            if best.strategy in tried_strategies:
                yield replace(best, candidate=candidate)

    def _smoothings(self, attempts: Sequence[Attempt]) -> Iterator[AttemptSpec]:
        """Yield smoothings of each strategy's best plan, and weaker ones if those were refused.

        How much a plan gains by it depends on its explosion, too: the second best may win. Turns
        are not smoothed for the calmest motion, because smoothing moves the hinges of many steps at
        once.
        """
        plans: dict[str, int] = {}
        for number, attempt in enumerate(attempts):
            if self.prefer == CALM and attempt.spec.strategy == TURNS:
                continue
            if attempt.verified and attempt.spec.smooths is None:
                best_number = plans.setdefault(attempt.spec.strategy, number)
                if score_of(attempt, self.prefer) > score_of(attempts[best_number], self.prefer):
                    plans[attempt.spec.strategy] = number
        ranked = sorted(plans.values(), key=lambda number: -score_of(attempts[number], self.prefer))
        smooth = {attempt.spec.smooths for attempt in attempts if attempt.verified}
        for best in ranked[:2]:
            figures, number = attempts[best].figures, best
            while attempts[number].repeats:  # its files are with those of the explosion
                number -= 1
            if figures is None or figures.frames > self.max_frames:
                continue
            spec = replace(attempts[best].spec.with_strategy(SMOOTHED), smooths=number)
            yield spec
            if number not in smooth:
                yield replace(spec, strategy=SOFTENED)
        smoothings = [attempt for attempt in attempts if attempt.spec.smooths is not None]
        if (best := best_of(smoothings, self.prefer)) is not None:
            spec = smoothings[best].spec
            seed = attempts[spec.smooths or 0].spec.seed
            for k in range(1, SEEDS_PER_SMOOTHED_PLAN):
                yield replace(spec, seed=(seed + k) % (MAX_SEED + 1))


def best_of(attempts: Sequence[Attempt], prefer: Preference) -> int | None:
    """Return the best verified attempt for a preference, the earlier of equal ones, or None.

    Args:
        attempts: All attempts of the fold, or some of them.
        prefer: Requested preference; with ``computing`` the first verified one is the best.
    """
    best: int | None = None
    for number, attempt in enumerate(attempts):
        if not attempt.verified:
            continue
        if best is None or (
            prefer != COMPUTING and score_of(attempt, prefer) > score_of(attempts[best], prefer)
        ):
            best = number
    return best


def score_of(attempt: Attempt, prefer: Preference) -> float:
    """Return the score of an attempt's plan for a preference, see ``PlanFigures.score``."""
    return float("-inf") if attempt.figures is None else attempt.figures.score(prefer)


def expected_seconds_of(spec: AttemptSpec, modules: int) -> float:
    """Return the expected seconds of an attempt, its playback and certificate; measured.

    Args:
        spec: The try.
        modules: Number of modules of the chain.
    """
    if spec.strategy == "peel":
        return 2.0 + 0.012 * modules
    together = 1.0 + 0.006 * modules + 1.4 * (modules / 160.0) ** 2.1
    if spec.strategy == "blocks":  # two dozen at most: their cost grows with the chain alone
        return min(together, 2.0 + 0.06 * modules)
    return together + (smoothing_seconds(modules) if spec.strategy in SMOOTHING_WAYS else 0.0)
