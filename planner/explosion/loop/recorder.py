"""Recorders: choice of the snapshots of an explosion from all its steps, as it runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Final, Generic, Protocol, TypeVar

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import forward_kinematics
from foldback.planner.chain.rotations import wxyz_from_matrix
from foldback.planner.clearance.clearance import closest
from foldback.planner.clearance.sweep import Between
from foldback.planner.motion.motion import Motion
from foldback.planner.simulation.reduced_state import State

CLEAR_ENOUGH_PITCH: Final = 0.06
"""Clearance, pitches, from which on the motion between two snapshots counts as safe, and no
snapshot is added."""
MIN_CLEARANCE_LOSS_PITCH: Final = 0.002
"""Minimum amount, pitches, by which modules come closer between two snapshots than at either of
them for a further snapshot to be recorded between them."""

S = TypeVar("S")


@dataclass(frozen=True, slots=True)
class Refusal:
    """Reason why snapshots are not recorded.

    Attributes:
        reason: Reason as a phrase.
        is_torque: True if stronger motors would help.
    """

    reason: str
    is_torque: bool = False


TOO_CLOSE: Final = Refusal("modules would come too close to each other")


@dataclass(frozen=True, slots=True)
class Mark(Generic[S]):
    """Position in a record that it may return to: number of parts, and last snapshot."""

    parts: int
    last: S | None


class SnapshotRule(Protocol[S]):
    """Rule by which snapshots are chosen from steps, and form of their motion."""

    commits_all: ClassVar[bool]
    """True if the last step of each commit is a snapshot."""

    def are_far(self, a: S, b: S) -> bool:
        """Return True if two snapshots are farther apart than allowed."""
        ...

    def clearance(self, a: S, b: S, *, divisible: bool) -> float | None:
        """Return the clearance of two snapshots and between them, pitches, as far as it counts.

        Args:
            a, b: Snapshots, one after the other.
            divisible: True if there are steps between them.

        Returns:
            None if another snapshot is needed between them.
        """
        ...

    def motion(self, snapshots: list[S]) -> Motion:
        """Return snapshots as a motion."""
        ...


Guard = Callable[[S | None, list[S]], Refusal | None]
"""Returns why snapshots, one after the other, may not follow an earlier one; None if they may."""


class Recorder(Generic[S]):
    """Recorder of every step: it chooses the snapshots that the record needs, and passes them on.

    Two neighbouring snapshots are about as far apart as they may be (a single step may be
    more), and the way between them is not closer to a collision than they are, as far as the
    steps allow.

    Args:
        rule: Rule by which snapshots are chosen.
        sink: Receives the snapshots.
        guard: Refuses snapshots.
    """

    def __init__(
        self,
        rule: SnapshotRule[S],
        sink: Callable[[Motion], None] | None,
        *,
        guard: Guard[S] | None = None,
    ) -> None:
        self._rule = rule
        self._sink = sink
        self._guard = guard
        self._steps: list[S] = []
        self._first: S | None = None
        self._last: S | None = None
        self._parts: list[Motion] = []

    def __len__(self) -> int:
        """Return the number of snapshots so far."""
        return sum(len(part) for part in self._parts)

    def add(self, step: S) -> None:
        """Add a step that may still be taken back."""
        if self._first is None:
            self._first = step
        self._steps.append(step)

    def take_back(self) -> None:
        """Drop the steps since the last ``commit``."""
        self._steps = []

    def commit(self, *, end: bool = False, min_clearance: float = -np.inf) -> Refusal | None:
        """Make the steps so far final and pass their snapshots on.

        Args:
            end: Make the last step a snapshot in any case.
            min_clearance: Minimum clearance, pitches, of snapshots and of the motion between them.

        Returns:
            The reason why the steps were dropped instead, or None.
        """
        steps, self._steps = self._steps, []
        accepted, done, clearance = self._choose(steps)
        if clearance < min_clearance:
            return TOO_CLOSE
        if self._guard is not None and (refusal := self._guard(self._last, accepted)) is not None:
            return refusal
        if accepted:
            self._last = accepted[-1]
        if end and steps[done:]:
            accepted.append(steps[-1])
        elif not end:
            self._steps = steps[done:]
        if accepted:
            self.append_motion(self._rule.motion(accepted))
        return None

    def close(self) -> None:
        """Make the last steps final; without a snapshot so far, record the first step.

        The guard may have refused every step. The first one is where the chain began, so that each
        record shows at least that.
        """
        self.commit(end=True)
        if not self._parts and self._first is not None:
            self.append([self._first])

    def append(self, snapshots: list[S]) -> None:
        """Add snapshots that were made without a simulation, after a ``commit``."""
        self._last = snapshots[-1]
        self.append_motion(self._rule.motion(snapshots))

    def append_motion(self, motion: Motion) -> None:
        """Add the end of a motion, and pass it on."""
        if len(motion):
            self._parts.append(motion)
            if self._sink is not None:
                self._sink(motion)

    def mark(self) -> Mark[S]:
        """Return the present end of the record."""
        return Mark(len(self._parts), self._last)

    def return_to(self, mark: Mark[S]) -> None:
        """Drop all snapshots after a mark, but not from the sink."""
        self._steps = []
        del self._parts[mark.parts :]
        self._last = mark.last

    def motion(self) -> Motion:
        """Return all snapshots so far."""
        return Motion.joined(self._parts)

    def _choose(self, steps: list[S]) -> tuple[list[S], int, float]:
        """Return the snapshots among steps, how many steps are done with, and the clearance."""
        accepted: list[S] = []
        last, done, clearance = self._last, 0, np.inf
        for k, step in enumerate(steps):
            if last is None or (self._rule.commits_all and k == len(steps) - 1):
                pick = k
            elif self._rule.are_far(last, step):
                pick = max(done, k - 1)
            else:
                continue
            if last is not None:
                between, step_clearance = self._between(last, steps[pick], steps[done:pick])
                accepted.extend(between)
                clearance = min(clearance, step_clearance)
            last = steps[pick]
            accepted.append(last)
            done = pick + 1
        return accepted, done, clearance

    def _between(self, a: S, b: S, steps: list[S]) -> tuple[list[S], float]:
        """Return the snapshots that are needed between two, and the clearance with them."""
        clearance = self._rule.clearance(a, b, divisible=bool(steps))
        if clearance is not None:
            return [], clearance
        k = len(steps) // 2
        before, clearance_before = self._between(a, steps[k], steps[:k])
        after, clearance_after = self._between(steps[k], b, steps[k + 1 :])
        return [*before, steps[k], *after], min(clearance_before, clearance_after)


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


@dataclass(frozen=True, kw_only=True)
class FrameRule:
    """Rule for frames of the whole chain.

    Attributes:
        chain: The chain.
        snapshot_rad: Maximum turn of a hinge from one snapshot to the next, rad.
        snapshot_distance: Maximum distance of a module from one snapshot to the next, pitches.
        size: Module size, as a fraction of the pitch, at which the motion between them is checked.
        spacing: Returns the factor of the allowed distance of snapshots. Above 1 the whole motion
            between two is checked, and not its middle only.
    """

    chain: Chain
    snapshot_rad: float
    snapshot_distance: float
    size: float
    spacing: Callable[[], float] = lambda: 1.0
    commits_all: ClassVar[bool] = False

    def are_far(self, a: Step, b: Step) -> bool:
        """Return True if two snapshots are farther apart than allowed."""
        spacing = self.spacing()
        if np.abs(a.angles - b.angles).max() >= spacing * self.snapshot_rad:
            return True
        moved = ((a.centres - b.centres) ** 2).sum(axis=1).max()
        return bool(moved >= (spacing * self.snapshot_distance) ** 2)

    def clearance(self, a: Step, b: Step, *, divisible: bool) -> float | None:
        """Return None if the motion between two snapshots comes closer than they are."""
        if not divisible:
            return np.inf
        if self.spacing() > 1.0:
            between = self._between.clearance(a.angles, b.angles, CLEAR_ENOUGH_PITCH)
        else:
            between = self._at(0.5 * (a.angles + b.angles))
        closer = between < CLEAR_ENOUGH_PITCH and between < (
            min(self._at(a.angles), self._at(b.angles)) - MIN_CLEARANCE_LOSS_PITCH
        )
        return None if closer else np.inf

    def motion(self, snapshots: list[Step]) -> Motion:
        """Return snapshots as a dense motion."""
        return Motion.from_frames(
            phase="explosion",
            time_s=np.array([s.time_s for s in snapshots]),
            joint_angles_rad=np.array([s.angles for s in snapshots]),
            root_position=np.array([s.position for s in snapshots]),
            root_wxyz=wxyz_from_matrix(np.array([s.rotation for s in snapshots])),
        )

    @cached_property
    def _between(self) -> Between:
        """Clearance between two configurations."""
        return Between(self.chain, self.size)

    def _at(self, angles: Array) -> float:
        """Return the clearance of one configuration, pitches."""
        poses = forward_kinematics(self.chain.module, angles, root=self.chain.root)
        return closest(
            self.chain.module,
            poses.positions,
            poses.rotations,
            module_size=self.size,
            enough=CLEAR_ENOUGH_PITCH,
        ).clearance
