"""Trajectories: retimed plans, a few at once, the last few kept."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from planner.readers.limits import megabytes
from server.gates import Gate
from server.problems import Problem

if TYPE_CHECKING:
    from planner.plan import Plan
    from planner.retiming import Trajectory

KEPT: Final = 4
STREAMS: Final = 4
"""Trajectories that are being sent, which may take those who take them a while."""
LARGEST_PLAN: Final = 64 * 2**20
"""Bytes of a plan that is retimed here; a larger one is for the command line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Retimed:
    """A plan and its trajectory within some bounds."""

    plan: Plan
    trajectory: Trajectory


class Trajectories:
    """Retimes plans. Used from many threads.

    Args:
        gate: Whom to let compute.
    """

    def __init__(self, gate: Gate) -> None:
        self.gate = gate
        self._lock = threading.Lock()
        self._streams = threading.BoundedSemaphore(STREAMS)
        self._kept: OrderedDict[tuple[Path, int, float, float], Retimed] = OrderedDict()

    def of(self, path: Path, max_speed: float, max_acceleration: float, visitor: str) -> Retimed:
        """The plan in a file, within bounds on its joints' speed and acceleration.

        Raises:
            Problem: When it is too large (413), or too many wait (429, 503).
            InputError: When it cannot be retimed.
        """
        from planner.plan import Plan
        from planner.retiming import retime

        found = path.stat()
        if found.st_size > LARGEST_PLAN:
            raise Problem(
                413,
                "too-large",
                f"got a plan of {megabytes(found.st_size)}, expected at most "
                f"{megabytes(LARGEST_PLAN)}; take plan.npz away and use `foldback retime`.",
            )
        key = (path, found.st_mtime_ns, max_speed, max_acceleration)
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
        with self.gate.passed(visitor):
            plan = Plan.load(path)
            made = Retimed(plan=plan, trajectory=retime(plan, max_speed, max_acceleration))
        with self._lock:
            self._kept[key] = made
            while len(self._kept) > KEPT:
                self._kept.popitem(last=False)
        return made

    def stream(self) -> Callable[[], None]:
        """Begins to send a trajectory; what comes back is to be called once at the end.

        Raises:
            Problem: When too many are being sent (503).
        """
        if not self._streams.acquire(blocking=False):
            raise Problem(
                503,
                "busy",
                "Others are being sent motions; try again in a moment.",
                headers={"Retry-After": "5"},
            )
        return self._streams.release
