"""Recorder of a peeling: windows of hinges, proved as the certificate proves them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.explosion.peeling_proof import Proof
from planner.explosion.peeling_window import Bend, Peelable
from planner.explosion.recorder import WORSE, Recorder
from planner.motion.angle_steps import snapped
from planner.motion.frames import PHASES
from planner.motion.windows import Windows

Array = NDArray[np.float64]
CLOSE: Final = 0.02
"""Clearance in pitches; larger ones are told as this."""
FARTHEST_TURN: Final = float(np.cos(0.1))
"""Cosine of the largest turn of the rod between two snapshots, 0.1 rad."""


@dataclass(frozen=True, slots=True)
class Mark:
    """A place of a record that it may return to: its parts, and its last snapshot."""

    parts: int
    last: Bend | None


class WindowRecorder(Recorder[Bend]):
    """Records configurations that are folded, bent, then straight.

    What is kept was swept as the certificate sweeps it, at the snapshots and everywhere between
    them.

    Args:
        peelable: The chain.
        proof: Sweeps it.
        snapshot_rad: Turn of a hinge from one snapshot to the next, at most.
        snapshot_distance: Way in pitches of a module that is in both windows, at most.
        sink: Gets the windows.
        holds: Whether snapshots may follow another one, asked of those that are about to be kept.
    """

    def __init__(
        self,
        peelable: Peelable,
        proof: Proof,
        *,
        snapshot_rad: float,
        snapshot_distance: float,
        sink: Callable[[Windows], None] | None,
        holds: Callable[[Bend | None, Sequence[Bend]], bool] | None = None,
    ) -> None:
        super().__init__()
        self._peelable = peelable
        self._proof = proof
        self._snapshot_rad = snapshot_rad
        self._snapshot_distance = snapshot_distance
        self._sink = sink
        self._holds = holds
        self._kept: list[Windows] = []
        self._least = CLOSE
        """Clearance of what is about to be kept."""

    def commit(self, *, end: bool = False, least: float = -np.inf) -> bool:
        """Makes the steps so far final and passes their snapshots on; the last one is one of them.

        Args:
            end: As the last one is a snapshot in any case, this changes nothing.
            least: When a snapshot or a place on the way to it has a clearance below this, or does
                not hold, all the steps are forgotten instead.

        Returns:
            Whether they were kept.
        """
        waiting, self._waiting = self._waiting, []
        self._least = CLOSE
        chosen, _ = self._chosen(waiting, to_the_end=True)
        if self._least < least or (self._holds is not None and not self._holds(self._last, chosen)):
            return False
        if chosen:
            self._last = chosen[-1]
        self._emit(chosen)
        return True

    def append(self, bends: list[Bend]) -> None:
        """Adds snapshots that were made without a simulation, and proved, after a ``commit``."""
        self._last = bends[-1]
        self._emit(bends)

    def mark(self) -> Mark:
        """Where the record ends now."""
        return Mark(len(self._kept), self._last)

    def return_to(self, mark: Mark) -> None:
        """Forgets all snapshots after a mark. Who got them has got them."""
        self._waiting = []
        del self._kept[mark.parts :]
        self._last = mark.last

    def motion(self) -> Windows:
        """All snapshots so far."""
        return Windows.joined(self._kept)

    def _emit(self, bends: list[Bend]) -> None:
        if not bends:
            return
        chain = self._peelable.chain
        hinges = self._peelable.hinges
        count = len(bends)
        windows = Windows(
            time_s=np.array([b.time_s for b in bends]),
            phase=np.full(count, PHASES.index("explosion"), dtype=np.uint8),
            first=np.array([hinges * b.first for b in bends], dtype=np.int64),
            offsets=np.concatenate([[0], np.cumsum([len(b.angles) for b in bends])]),
            angles_rad=snapped(np.concatenate([b.angles for b in bends])).astype(np.float32),
            base_position=np.tile(chain.folded_position, (count, 1)),
            base_wxyz=np.tile(chain.folded_wxyz, (count, 1)),
        )
        self._kept.append(windows)
        if self._sink is not None:
            self._sink(windows)

    def _far(self, a: Bend, b: Bend) -> bool:
        _, one, other = self._peelable.together(a, b)
        if np.abs(one - other).max(initial=0.0) >= self._snapshot_rad:
            return True
        if a.along is not None and b.along is not None and a.along @ b.along < FARTHEST_TURN:
            return True
        return self._moved(a, b) >= self._snapshot_distance

    def _moved(self, a: Bend, b: Bend) -> float:
        """How far a module of both windows has gone; 0 where that is not known."""
        if a.centres is None or b.centres is None:
            return 0.0
        low = max(a.first, b.first)
        high = min(a.first + len(a.centres), b.first + len(b.centres))
        gone = a.centres[low - a.first : high - a.first] - b.centres[low - b.first : high - b.first]
        return float(np.sqrt((gone**2).sum(axis=1).max(initial=0.0)))

    def _needs_more(self, a: Bend, b: Bend, *, more: bool) -> bool:
        least, each = self._proof.keeps((a, b), CLOSE)
        if more and least < each.min() - WORSE:
            return True
        self._least = min(self._least, least)
        return False
