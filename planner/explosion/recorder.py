"""Recorders: pick the snapshots of an explosion from all its steps, as it runs."""

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
from planner.motion.frames import Frames
from planner.simulation.reduced import State

Array = NDArray[np.float64]
CLOSE: Final = 0.06
"""Clearance in pitches from which on a place between two snapshots is clear enough."""
WORSE: Final = 0.002
"""Pitches by which a place between is nearer than both snapshots, if one is recorded there."""

S = TypeVar("S")


class Recorder(ABC, Generic[S]):
    """Takes every step, keeps the snapshots that the record needs, and passes them on.

    Two neighbouring snapshots are about as far apart as they may be (a single step may be
    more), and the way between them is not closer to a collision than they are, as far as the
    steps allow.
    """

    def __init__(self) -> None:
        self._waiting: list[S] = []
        self._last: S | None = None

    def add(self, step: S) -> None:
        """Takes a step that may still be taken back."""
        self._waiting.append(step)

    def take_back(self) -> None:
        """Forgets the steps since the last ``commit``."""
        self._waiting = []

    @abstractmethod
    def commit(self, *, end: bool = False) -> bool:
        """Makes the steps so far final and passes their snapshots on.

        Args:
            end: Keep the last step as a snapshot in any case.

        Returns:
            Whether they were kept.
        """

    @abstractmethod
    def _far(self, a: S, b: S) -> bool:
        """Whether two snapshots are farther apart than they may be."""

    @abstractmethod
    def _needs_more(self, a: S, b: S, *, more: bool) -> bool:
        """Whether the way between two snapshots asks for another, if there are more steps."""

    def _chosen(self, waiting: list[S], *, to_the_end: bool) -> tuple[list[S], int]:
        """The snapshots among steps, and how many of these are done with.

        Args:
            waiting: The steps.
            to_the_end: Whether the last one is a snapshot.
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
        """The snapshots that are needed between two, from the steps between them."""
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
    """One step of a simulation: time, configuration, and where the modules were."""

    time_s: float
    angles: Array
    position: Array
    rotation: Array
    centres: Array

    @classmethod
    def of(cls, time_s: float, state: State, centres: Array) -> Step:
        """A copy of a state."""
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
        snapshot_rad: Turn of a hinge from one snapshot to the next, at most.
        snapshot_distance: Way of a module in pitches from one snapshot to the next, at most.
        size: Module size at which the way between them is looked at.
        sink: Gets the frames.
    """

    def __init__(
        self,
        chain: Chain,
        *,
        snapshot_rad: float,
        snapshot_distance: float,
        size: float,
        sink: Callable[[Frames], None] | None,
    ) -> None:
        super().__init__()
        self._chain = chain
        self._snapshot_rad = snapshot_rad
        self._snapshot_distance = snapshot_distance
        self._size = size
        self._sink = sink
        self._kept: list[Frames] = []
        self.spacing = 1.0
        """How many times as far apart snapshots may be now. Above 1 all of the way between two is
        looked at, and not its middle only."""
        self._way = Between(chain, size)

    def __len__(self) -> int:
        """Snapshots so far."""
        return sum(len(part) for part in self._kept)

    def commit(self, *, end: bool = False) -> bool:
        """Makes the steps so far final and passes their snapshots on.

        Args:
            end: Keep the last step as a snapshot in any case.
        """
        waiting = self._waiting
        chosen, first = self._chosen(waiting, to_the_end=False)
        if chosen:
            self._last = chosen[-1]
        if end and waiting[first:]:
            chosen.append(waiting[-1])
        self._waiting = [] if end else waiting[first:]
        self._emit(chosen)
        return True

    def append(self, frames: Frames) -> None:
        """Adds frames that were made without a simulation."""
        if len(frames):
            self._kept.append(frames)
            if self._sink is not None:
                self._sink(frames)

    def motion(self) -> Frames:
        """All snapshots so far."""
        return Frames.joined(self._kept)

    def _emit(self, steps: list[Step]) -> None:
        if not steps:
            return
        self.append(
            Frames.of_phase(
                "explosion",
                time_s=np.array([s.time_s for s in steps]),
                joint_angles_rad=np.array([s.angles for s in steps]),
                root_position=np.array([s.position for s in steps]),
                root_wxyz=wxyz_from_matrix(np.array([s.rotation for s in steps])),
            )
        )

    def _far(self, a: Step, b: Step) -> bool:
        if np.abs(a.angles - b.angles).max() >= self.spacing * self._snapshot_rad:
            return True
        moved = ((a.centres - b.centres) ** 2).sum(axis=1).max()
        return bool(moved >= (self.spacing * self._snapshot_distance) ** 2)

    def _needs_more(self, a: Step, b: Step, *, more: bool) -> bool:
        if not more:
            return False
        if self.spacing > 1.0:
            between = self._way.clearance(a.angles, b.angles, CLOSE)
        else:
            between = self._clearance(0.5 * (a.angles + b.angles))
        return between < CLOSE and between < (
            min(self._clearance(a.angles), self._clearance(b.angles)) - WORSE
        )

    def _clearance(self, angles: Array) -> float:
        poses = forward_kinematics(self._chain.module, angles, root=self._chain.root)
        return closest(
            self._chain.module, poses.positions, poses.rotations, size=self._size, enough=CLOSE
        ).clearance
