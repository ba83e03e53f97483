"""Recorders: choice of the snapshots of an explosion from all its steps, as it runs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.chain.kinematics import forward_kinematics
from planner.chain.rotations import wxyz_from_matrix
from planner.clearance.clearance import closest
from planner.clearance.sweep import Between
from planner.motion.motion import Motion
from planner.simulation.reduced import State

Array = NDArray[np.float64]
CLEAR_ENOUGH_PITCH: Final = 0.06
"""Clearance between two snapshots, pitches, that needs no further snapshot. Larger values keep
more. Chosen."""
MIN_CLEARANCE_LOSS_PITCH: Final = 0.002
"""Minimum loss of clearance between two snapshots, pitches, for which another one is kept between
them. Smaller values keep more. Chosen."""

S = TypeVar("S")


class Recorder(ABC, Generic[S]):
    """Recorder of every step: it keeps the snapshots that the record needs, and passes them on.

    Two neighbouring snapshots are about as far apart as they may be (a single step may be
    more), and the way between them is not closer to a collision than they are, as far as the
    steps allow.
    """

    def __init__(self) -> None:
        self._waiting: list[S] = []
        self._last: S | None = None

    def add(self, step: S) -> None:
        """Add a step that may still be taken back."""
        self._waiting.append(step)

    def take_back(self) -> None:
        """Drop the steps since the last ``commit``."""
        self._waiting = []

    @abstractmethod
    def commit(self, *, end: bool = False) -> object:
        """Make the steps so far final and pass their snapshots on.

        Args:
            end: Make the last step a snapshot in any case.
        """

    def close(self, step: S, *, straight: bool) -> None:
        """Make all steps final; the last one is a snapshot unless the record ends straight."""
        del step
        self.commit(end=not straight)

    @abstractmethod
    def _far(self, a: S, b: S) -> bool:
        """Return True if two snapshots are farther apart than allowed."""

    @abstractmethod
    def _needs_more(self, a: S, b: S, *, more: bool) -> bool:
        """Return True if the motion between two snapshots needs another one, of ``more`` steps."""

    def _chosen(self, waiting: list[S], *, to_the_end: bool) -> tuple[list[S], int]:
        """Return the snapshots among steps, and the number of steps that are done with.

        Args:
            waiting: The steps.
            to_the_end: True if the last one is a snapshot in any case.
        """
        chosen: list[S] = []
        last = self._last
        first = 0
        for k, step in enumerate(waiting):
            if last is None or (to_the_end and k == len(waiting) - 1):
                pick = k
            elif self._far(last, step):
                pick = max(first, k - 1)
            else:
                continue
            if last is not None:
                chosen.extend(self._between(last, waiting[pick], waiting[first:pick]))
            last = waiting[pick]
            chosen.append(last)
            first = pick + 1
        return chosen, first

    def _between(self, a: S, b: S, steps: list[S]) -> list[S]:
        """Return the snapshots that are needed between two, from the steps between them."""
        if not self._needs_more(a, b, more=bool(steps)):
            return []
        middle = len(steps) // 2
        return [
            *self._between(a, steps[middle], steps[:middle]),
            steps[middle],
            *self._between(steps[middle], b, steps[middle + 1 :]),
        ]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Step:
    """One step of a simulation: time, configuration, and centres of the modules."""

    time_s: float
    angles: Array
    position: Array
    rotation: Array
    centres: Array

    @classmethod
    def of(cls, time_s: float, state: State, centres: Array) -> Step:
        """Copy a state."""
        return cls(
            time_s=time_s,
            angles=state.angles.copy(),
            position=state.position.copy(),
            rotation=state.rotation.copy(),
            centres=centres.copy(),
        )


class FrameRecorder(Recorder[Step]):
    """Records frames of the whole chain.

    Args:
        chain: The chain.
        snapshot_rad: Maximum turn of a hinge from one snapshot to the next, rad.
        snapshot_distance: Maximum distance of a module from one snapshot to the next, pitches.
        size: Module size, as a fraction of the pitch, at which the motion between them is checked.
        sink: Receives the frames.
        spacing: Returns the factor of the allowed distance of snapshots. Above 1 the whole motion
            between two is checked, and not its middle only.
    """

    def __init__(
        self,
        chain: Chain,
        *,
        snapshot_rad: float,
        snapshot_distance: float,
        size: float,
        sink: Callable[[Motion], None] | None,
        spacing: Callable[[], float] = lambda: 1.0,
    ) -> None:
        super().__init__()
        self._chain = chain
        self._snapshot_rad = snapshot_rad
        self._snapshot_distance = snapshot_distance
        self._size = size
        self._sink = sink
        self._kept: list[Motion] = []
        self._spacing = spacing
        self._way = Between(chain, size)

    def __len__(self) -> int:
        """Return the number of snapshots so far."""
        return sum(len(part) for part in self._kept)

    def commit(self, *, end: bool = False) -> None:
        """Make the steps so far final and pass their snapshots on.

        Args:
            end: Make the last step a snapshot in any case.
        """
        waiting = self._waiting
        chosen, first = self._chosen(waiting, to_the_end=False)
        if chosen:
            self._last = chosen[-1]
        if end and waiting[first:]:
            chosen.append(waiting[-1])
        self._waiting = [] if end else waiting[first:]
        self._emit(chosen)

    def append(self, frames: Motion) -> None:
        """Add frames that were made without a simulation."""
        if len(frames):
            self._kept.append(frames)
            if self._sink is not None:
                self._sink(frames)

    def motion(self) -> Motion:
        """Return all snapshots so far."""
        return Motion.joined(self._kept)

    def _emit(self, steps: list[Step]) -> None:
        if not steps:
            return
        self.append(
            Motion.from_frames(
                phase="explosion",
                time_s=np.array([s.time_s for s in steps]),
                joint_angles_rad=np.array([s.angles for s in steps]),
                root_position=np.array([s.position for s in steps]),
                root_wxyz=wxyz_from_matrix(np.array([s.rotation for s in steps])),
            )
        )

    def _far(self, a: Step, b: Step) -> bool:
        spacing = self._spacing()
        if np.abs(a.angles - b.angles).max() >= spacing * self._snapshot_rad:
            return True
        moved = ((a.centres - b.centres) ** 2).sum(axis=1).max()
        return bool(moved >= (spacing * self._snapshot_distance) ** 2)

    def _needs_more(self, a: Step, b: Step, *, more: bool) -> bool:
        if not more:
            return False
        if self._spacing() > 1.0:
            between = self._way.clearance(a.angles, b.angles, CLEAR_ENOUGH_PITCH)
        else:
            between = self._clearance(0.5 * (a.angles + b.angles))
        return between < CLEAR_ENOUGH_PITCH and between < (
            min(self._clearance(a.angles), self._clearance(b.angles)) - MIN_CLEARANCE_LOSS_PITCH
        )

    def _clearance(self, angles: Array) -> float:
        poses = forward_kinematics(self._chain.module, angles, root=self._chain.root)
        return closest(
            self._chain.module,
            poses.positions,
            poses.rotations,
            size=self._size,
            enough=CLEAR_ENOUGH_PITCH,
        ).clearance
