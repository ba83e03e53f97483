"""Recorder of a peeling: windows of hinges, proved as the certificate proves them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.explosion.peeling_proof import Proof
from planner.explosion.peeling_window import Peelable, WindowConfiguration
from planner.explosion.recorder import MIN_CLEARANCE_LOSS_PITCH, Recorder
from planner.motion.angle_steps import snapped
from planner.motion.motion import Motion

Array = NDArray[np.float64]
CLEARANCE_CAP_PITCH: Final = 0.02
"""Cap of the clearance, pitches: larger ones count as this. Larger values take more time.
Chosen."""
MIN_SNAPSHOT_COSINE: Final = float(np.cos(0.1))
"""Cosine of the maximum turn of the rod between two snapshots, 0.1 rad. Chosen."""


@dataclass(frozen=True, slots=True)
class Mark:
    """Position in a record that it may return to: number of parts, and last snapshot."""

    parts: int
    last: WindowConfiguration | None


class WindowRecorder(Recorder[WindowConfiguration]):
    """Records configurations that are folded, bent, then straight.

    Snapshots are kept only with a proof of clearance, at and between them, as in the certificate.

    Args:
        peelable: The chain.
        proof: Proof of its clearance.
        snapshot_rad: Maximum turn of a hinge from one snapshot to the next, rad.
        snapshot_distance: Maximum distance that a module of both windows moves, pitches.
        sink: Receives the windows.
        holds: Returns True if the given snapshots may follow another one.
    """

    def __init__(
        self,
        peelable: Peelable,
        proof: Proof,
        *,
        snapshot_rad: float,
        snapshot_distance: float,
        sink: Callable[[Motion], None] | None,
        holds: Callable[[WindowConfiguration | None, Sequence[WindowConfiguration]], bool]
        | None = None,
    ) -> None:
        super().__init__()
        self._peelable = peelable
        self._proof = proof
        self._snapshot_rad = snapshot_rad
        self._snapshot_distance = snapshot_distance
        self._sink = sink
        self._holds = holds
        self._kept: list[Motion] = []
        self._least = CLEARANCE_CAP_PITCH
        """Least clearance of the snapshots that are about to be kept, pitches."""

    def commit(self, *, end: bool = False, least: float = -np.inf) -> bool:
        """Make the steps so far final and pass their snapshots on; the last step is one of them.

        Args:
            end: Without effect: the last step is a snapshot in any case.
            least: Minimum clearance, pitches, of snapshots and of the motion between them. With
                less, or if ``holds`` refuses one, all the steps are dropped instead.

        Returns:
            True if they were kept.
        """
        waiting, self._waiting = self._waiting, []
        self._least = CLEARANCE_CAP_PITCH
        chosen, _ = self._chosen(waiting, to_the_end=True)
        if self._least < least or (self._holds is not None and not self._holds(self._last, chosen)):
            return False
        if chosen:
            self._last = chosen[-1]
        self._emit(chosen)
        return True

    def append(self, bends: list[WindowConfiguration]) -> None:
        """Add snapshots that were made without a simulation, and proved, after a ``commit``."""
        self._last = bends[-1]
        self._emit(bends)

    def mark(self) -> Mark:
        """Return the present end of the record."""
        return Mark(len(self._kept), self._last)

    def return_to(self, mark: Mark) -> None:
        """Drop all snapshots after a mark; the sink is not told."""
        self._waiting = []
        del self._kept[mark.parts :]
        self._last = mark.last

    def motion(self) -> Motion:
        """Return all snapshots so far."""
        return Motion.joined(self._kept)

    def _emit(self, bends: list[WindowConfiguration]) -> None:
        if not bends:
            return
        chain = self._peelable.chain
        hinges = self._peelable.hinges
        count = len(bends)
        windows = Motion.from_windows(
            time_s=np.array([b.time_s for b in bends]),
            phase="explosion",
            first=np.array([hinges * b.first for b in bends], dtype=np.int64),
            offsets=np.concatenate([[0], np.cumsum([len(b.angles) for b in bends])]),
            angles_rad=snapped(np.concatenate([b.angles for b in bends])).astype(np.float32),
            base_position=np.tile(chain.folded_position, (count, 1)),
            base_wxyz=np.tile(chain.folded_wxyz, (count, 1)),
        )
        self._kept.append(windows)
        if self._sink is not None:
            self._sink(windows)

    def _far(self, a: WindowConfiguration, b: WindowConfiguration) -> bool:
        _, one, other = self._peelable.together(a, b)
        if np.abs(one - other).max(initial=0.0) >= self._snapshot_rad:
            return True
        if a.along is not None and b.along is not None and a.along @ b.along < MIN_SNAPSHOT_COSINE:
            return True
        return self._moved(a, b) >= self._snapshot_distance

    def _moved(self, a: WindowConfiguration, b: WindowConfiguration) -> float:
        """Return the largest distance of a module of both windows, pitches; 0 if unknown."""
        if a.centres is None or b.centres is None:
            return 0.0
        low = max(a.first, b.first)
        high = min(a.first + len(a.centres), b.first + len(b.centres))
        gone = a.centres[low - a.first : high - a.first] - b.centres[low - b.first : high - b.first]
        return float(np.sqrt((gone**2).sum(axis=1).max(initial=0.0)))

    def _needs_more(self, a: WindowConfiguration, b: WindowConfiguration, *, more: bool) -> bool:
        least, each = self._proof.keeps((a, b), CLEARANCE_CAP_PITCH)
        if more and least < each.min() - MIN_CLEARANCE_LOSS_PITCH:
            return True
        self._least = min(self._least, least)
        return False
