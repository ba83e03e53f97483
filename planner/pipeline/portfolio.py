"""Portfolio: what is tried when an explosion sticks, or its plan is refused.

What comes next is decided by what was tried so far and by why it failed, and by nothing else: the
same fold always takes the same way.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

MOST: Final = 6
"""Explosions of one fold."""
MOST_SEEDS: Final = 3
LARGEST_SEED: Final = 2**32 - 1
CHANGES: Final[dict[str, tuple[str, ...]]] = {
    "knot": ("path", "strategy"),
    "buried": ("end", "strategy", "path", "seed"),
    "contacts": ("forces", "strategy", "path", "seed"),
    "joints": ("path", "strategy", "end", "seed"),
    "broken": ("strategy", "path", "seed"),
    "limit": ("strategy", "path"),
    "refused": ("path", "seed", "strategy", "forces"),
}
"""What is changed first, for each reason: the end it begins at, forces, strategy, path or seed."""
LIKELY: Final = {"peel": "buried"}
"""Why a strategy sticks, mostly; the others do so in joints."""

ONE_ENDED: Final = ("peel", "one-by-one")
"""Strategies that begin at one end of the chain."""
SET: Final = ("one-by-one",)
"""Strategies that neither forces nor seeds change anything of."""


@dataclass(frozen=True, slots=True)
class Try:
    """One explosion that may be made.

    Attributes:
        candidate: Which of the paths.
        seed: What randomness starts from.
        strategy: How the chain is let go.
        other_end: Whether the path is taken from its other end.
        gentle: Whether it is let go with half the force.
    """

    candidate: int
    seed: int
    strategy: str
    other_end: bool = False
    gentle: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """What there is to choose from.

    Attributes:
        strategies: For each path, the strategies that it may have, the best first.
        seed: What the fold starts from.
        two_ended: Whether a path may be taken from its other end.
        forces: Whether the forces may be others than asked for.
        seeds: How many of them may be tried.
    """

    strategies: tuple[tuple[str, ...], ...]
    seed: int
    two_ended: bool = False
    forces: bool = False
    seeds: int = MOST_SEEDS

    def after(self, tried: Sequence[dict[str, Any]]) -> Try | None:
        """What is tried after so many attempts; None when enough was tried.

        Args:
            tried: The attempts so far: what a ``Try`` has, ``status``, and what is known of
                ``diagnosis``. Those with finer frames repeat an explosion.
        """
        if not tried:
            return Try(0, self.seed, self.strategies[0][0])
        if sum("finer" not in attempt for attempt in tried) >= MOST:
            return None
        done = {_try_of(attempt) for attempt in tried}
        last = tried[-1]
        for change in CHANGES[_reason(last)]:
            for other in self._changed(change, _try_of(last)):
                if other not in done:
                    return other
        return None

    def ahead(
        self,
        tried: Sequence[dict[str, Any]],
        here: Try,
        known: Mapping[Try, dict[str, Any]] | None = None,
    ) -> list[Try]:
        """What may come after a try that is being made, the likeliest first.

        A strategy likely fails as it did before. What is known to come straight may be refused.

        Args:
            tried: The attempts before it.
            here: What is being made.
            known: What came of others that were made already.
        """
        known = known or {}
        seen = {attempt["strategy"]: _reason(attempt) for attempt in tried}
        found: dict[Try, None] = {}
        for reason in (None, *CHANGES):
            todo: Try | None = here
            failed = list(tried)
            while todo is not None:
                likely = seen.get(todo.strategy) or LIKELY.get(todo.strategy, "joints")
                failed.append(known.get(todo) or _failed(todo, reason or likely))
                todo = self.after(failed)
                if todo is not None:
                    found[todo] = None
        return list(found)

    def _changed(self, change: str, here: Try) -> Iterator[Try]:
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


def _try_of(attempt: dict[str, Any]) -> Try:
    return Try(**{name: attempt[name] for name in Try.__dataclass_fields__ if name in attempt})


def _reason(attempt: dict[str, Any]) -> str:
    """Why an attempt was not the last one."""
    if attempt["status"] == "straight":
        return "refused"
    return str((attempt.get("diagnosis") or {}).get("kind", "limit"))


def _failed(todo: Try, reason: str) -> dict[str, Any]:
    """An attempt that fails for a reason."""
    return {
        **asdict(todo),
        "status": "straight" if reason == "refused" else "stalled",
        "diagnosis": None if reason == "refused" else {"kind": reason},
    }
