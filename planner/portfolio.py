"""Portfolio: what is tried when an explosion sticks, or its plan is refused.

What comes next is decided by what was tried so far and by why it failed, and by nothing else: the
same fold always takes the same way.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

MOST: Final = 6
"""Explosions of one fold."""
MOST_SEEDS: Final = 3
LARGEST_SEED: Final = 2**32 - 1
CHANGES: Final[dict[str, tuple[str, ...]]] = {
    "knot": ("path", "strategy"),
    "buried": ("strategy", "path", "seed"),
    "contacts": ("strategy", "path", "seed"),
    "joints": ("path", "strategy", "seed"),
    "limit": ("strategy", "path"),
    "refused": ("path", "seed", "strategy"),
}
"""What is changed first, for each reason: another path, strategy or seed."""


@dataclass(frozen=True, slots=True)
class Try:
    """One explosion that may be made.

    Attributes:
        candidate: Which of the paths.
        seed: What randomness starts from.
        strategy: How the chain is let go.
    """

    candidate: int
    seed: int
    strategy: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """What there is to choose from.

    Attributes:
        strategies: For each path, the strategies that it may have, the best first.
        seed: What the fold starts from.
    """

    strategies: tuple[tuple[str, ...], ...]
    seed: int

    def after(self, tried: Sequence[dict[str, Any]]) -> Try | None:
        """What is tried after so many attempts; None when enough was tried.

        Args:
            tried: The attempts so far: ``candidate``, ``seed``, ``strategy``, ``status``, and what
                is known of ``diagnosis``. Those with finer frames repeat an explosion.
        """
        if not tried:
            return Try(0, self.seed, self.strategies[0][0])
        if sum("finer" not in attempt for attempt in tried) >= MOST:
            return None
        done = {_try_of(attempt) for attempt in tried}
        last = tried[-1]
        reason = "refused" if last["status"] == "straight" else _kind(last)
        for change in CHANGES[reason]:
            for other in self._changed(change, _try_of(last)):
                if other not in done:
                    return other
        return None

    def _changed(self, change: str, here: Try) -> Iterator[Try]:
        """What there is by one change, the nearest first."""
        if change == "path":
            for candidate, known in enumerate(self.strategies):
                strategy = here.strategy if here.strategy in known else known[0]
                yield Try(candidate, here.seed, strategy)
        elif change == "strategy":
            for strategy in self.strategies[here.candidate]:
                yield Try(here.candidate, here.seed, strategy)
        else:
            for k in range(MOST_SEEDS):
                yield Try(here.candidate, (self.seed + k) % (LARGEST_SEED + 1), here.strategy)


def _try_of(attempt: dict[str, Any]) -> Try:
    return Try(attempt["candidate"], attempt["seed"], attempt["strategy"])


def _kind(attempt: dict[str, Any]) -> str:
    return str((attempt.get("diagnosis") or {}).get("kind", "limit"))
