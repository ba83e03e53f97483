"""Limits: what one computing process may use, and the words when it wants more."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from server.settings import Settings


@dataclass(frozen=True, slots=True, kw_only=True)
class ChildLimits:
    """What one computing process may use, and how readily it lets others go first."""

    memory_bytes: int
    cpu_s: float
    niceness: int = 0

    @classmethod
    def of(cls, settings: Settings) -> ChildLimits:
        """The limits that the settings say."""
        return cls(
            memory_bytes=settings.child_memory_bytes,
            cpu_s=settings.stage_cpu_seconds,
            niceness=settings.niceness,
        )


def memory_words(limit_bytes: int) -> str:
    """What is said when a fold would need more memory than it may use."""
    return (
        f"the fold needs more than the {limit_bytes // 2**20} MiB of memory it may use; try a "
        "smaller shape."
    )
