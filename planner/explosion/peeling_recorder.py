"""Recorder of a peeling: windows of hinges, proved as the certificate proves them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.clearance.sweep import windows_shape
from planner.explosion.recorder import MIN_CLEARANCE_LOSS_PITCH, Recorder
from planner.explosion.window import Peelable, WindowConfiguration
from planner.kernels.sweep import Angles, sweep_frames
from planner.motion.angle_steps import snapped
from planner.motion.motion import Motion

Array = NDArray[np.float64]
CLEARANCE_CAP_PITCH: Final = 0.02
"""Cap of the clearance, pitches: larger ones count as this. Larger values take more time.
Chosen."""
MIN_SNAPSHOT_CLEARANCE_PITCH: Final = 0.002
"""Minimum clearance of snapshots at the size to verify, pitches. Chosen."""
CLEARANCE_ROUNDING_PITCH: Final = 1e-9
"""Clearance that rounding may take from a snapshot, or from the motion to it, pitches."""
MIN_SNAPSHOT_COSINE: Final = float(np.cos(0.1))
"""Cosine of the maximum turn of the rod between two snapshots, 0.1 rad. Chosen."""


@dataclass(frozen=True, slots=True)
class Refusal:
    """Reason why snapshots are not recorded.

    Attributes:
        reason: Reason as a phrase.
        is_torque: True if stronger motors would help.
    """

    reason: str
    is_torque: bool = False


TOO_CLOSE: Final = Refusal("modules would come too close")
Guarding = Callable[[WindowConfiguration | None, Sequence[WindowConfiguration]], Refusal | None]
"""Returns why snapshots, one after the other, may not follow an earlier one; None if they may."""


class Proof:
    """Proof of the clearance at and between snapshots, as in the certificate, at one module size.

    Folded modules are not checked against each other, nor are straight ones: they do not change.
    """

    def __init__(self, chain: Chain, size: float) -> None:
        # Folded neighbours are no farther apart than the module size leaves.
        self.least = min(
            MIN_SNAPSHOT_CLEARANCE_PITCH, 0.5 * (1.0 - size) - CLEARANCE_ROUNDING_PITCH
        )
        """Minimum clearance of snapshots, pitches."""
        self._hinges = chain.module.hinges_per_joint
        self._shape = windows_shape(chain, size)

    def is_clear(self, configurations: Sequence[WindowConfiguration]) -> bool:
        """Return True if configurations, and the motion between them, keep that clearance."""
        return self.keeps(configurations, self.least)[0] >= self.least

    def keeps(self, bends: Sequence[WindowConfiguration], enough: float) -> tuple[float, Array]:
        """Return the least clearance of configurations and of the linear motion between them.

        Args:
            bends: F configurations, in their order; their angles count in single precision.
            enough: Cap of the clearances, pitches: larger ones count as this.

        Returns:
            The least of all, not above 0 where the motion between two could not be proved, and
            (F,) that of each configuration; pitches.
        """
        count = len(bends)
        lengths = [len(bend.angles) for bend in bends]
        values = np.concatenate([bend.angles for bend in bends])
        angles = Angles(
            first=np.array([self._hinges * bend.first for bend in bends], dtype=np.int64),
            offsets=np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64),
            shift=0,
            values=values.astype(np.float32).astype(np.float64),
        )
        per_frame = np.full(count, enough)
        found = sweep_frames(
            self._shape, angles, 0, count, enough, np.full(count, enough), per_frame, 0.0
        )
        proved = found.lower_bound > 0.0
        return (found.clearance if proved else min(found.clearance, 0.0)), per_frame


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
        guard: Refuses snapshots for other reasons than their clearance.
    """

    def __init__(
        self,
        peelable: Peelable,
        proof: Proof,
        *,
        snapshot_rad: float,
        snapshot_distance: float,
        sink: Callable[[Motion], None] | None,
        guard: Guarding | None = None,
    ) -> None:
        super().__init__()
        self._peelable = peelable
        self._proof = proof
        self._snapshot_rad = snapshot_rad
        self._snapshot_distance = snapshot_distance
        self._sink = sink
        self._guard = guard
        self._kept: list[Motion] = []
        self._least = CLEARANCE_CAP_PITCH
        """Least clearance of the snapshots that are about to be kept, pitches."""

    def commit(self, *, end: bool = False) -> Refusal | None:
        """Make the steps so far final, whatever their clearance; see ``commit_clear``.

        Args:
            end: Without effect: the last step is a snapshot in any case.
        """
        del end
        return self.commit_clear(-np.inf)

    def commit_clear(self, least: float) -> Refusal | None:
        """Make the steps so far final and pass their snapshots on; the last step is one of them.

        Args:
            least: Minimum clearance, pitches, of snapshots and of the motion between them.

        Returns:
            The reason why the steps were dropped instead, or None.
        """
        waiting, self._waiting = self._waiting, []
        self._least = CLEARANCE_CAP_PITCH
        chosen, _ = self._chosen(waiting, to_the_end=True)
        if self._least < least:
            return TOO_CLOSE
        refusal = None if self._guard is None else self._guard(self._last, chosen)
        if refusal is not None:
            return refusal
        if chosen:
            self._last = chosen[-1]
        self._emit(chosen)
        return None

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
