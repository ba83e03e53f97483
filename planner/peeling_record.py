"""Record of a peeling: its snapshots and what came of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from planner.record import RecordStatus
from planner.windows import Windows


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PeelRecord:
    """The outcome of a peeling. A failed one is data too.

    Attributes:
        status: ``straight`` when the chain came out, else why it did not.
        reason: In plain words; empty when straight.
        frames: Snapshots from folded on; the last one is straight if the status says so.
        steps: Simulation steps.
        seconds: Wall time.
    """

    status: RecordStatus
    reason: str
    frames: Windows
    steps: int
    seconds: float

    def summary(self) -> dict[str, Any]:
        """The figures without the frames."""
        return {
            "status": self.status,
            "reason": self.reason,
            "steps": self.steps,
            "frames": len(self.frames),
            "seconds": self.seconds,
        }
