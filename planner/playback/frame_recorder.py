"""Frame recorder: puts the frames of a simulated playback together as motions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.motion.angle_encoding import quantised
from foldback.planner.motion.motion import Motion, Phase
from foldback.planner.playback.setpoints import Target

MAX_WAITING_FRAMES: Final = 64
"""Maximum number of frames that wait to be put together as one motion. A motion of each frame takes
longer than the step that it shows."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecordedFrames:
    """F recorded frames.

    Attributes:
        steps: (F,) number of steps before each.
        targets_rad: (F, J) planned hinge angles, rad.
        angles_rad: (F, J) hinge angles, rad.
        root_position, root_wxyz: (F, 3), (F, 4) pose of the root.
    """

    steps: Ints
    targets_rad: Array
    angles_rad: Array
    root_position: Array
    root_wxyz: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecordedFrame:
    """A recorded frame.

    Attributes:
        phase: Phase of the playback.
        step: Number of steps before it.
        target: Target of the coming step.
        angles: (J,) hinge angles, rad.
        root_position, root_wxyz: (3,), (4,) pose of the root.
    """

    phase: Phase
    step: int
    target: Target
    angles: Array
    root_position: Array
    root_wxyz: Array


class FrameRecorder:
    """Recorder of the frames of one simulation.

    Attributes:
        last: The last frame of the present phase; None if there is none.

    Args:
        start_s: Time of the simulation's beginning, s.
        step_s: Time step, s.
        sink: Receives the frames, some at a time; None if nobody follows.
    """

    def __init__(
        self, start_s: float, step_s: float, sink: Callable[[Motion], None] | None
    ) -> None:
        self.last: RecordedFrame | None = None
        self._start_s, self._step_s, self._sink = start_s, step_s, sink
        self._waiting: list[RecordedFrame] = []
        self._motions: list[Motion] = []
        self._references: list[Array] = []
        self._count = 0

    def __len__(self) -> int:
        """Return the number of frames."""
        return self._count

    @property
    def motion(self) -> Motion:
        """All frames."""
        self.flush()
        return Motion.joined(self._motions)

    @property
    def reference_rad(self) -> Array:
        """(F, J) planned angles at the frames, in whole steps."""
        self.flush()
        return quantised(np.concatenate(self._references))

    def append(self, frame: RecordedFrame) -> None:
        """Record a frame; its arrays must not change from now on."""
        waiting = self._waiting
        if len(waiting) == MAX_WAITING_FRAMES or (waiting and waiting[-1].phase != frame.phase):
            self.flush()
        self._waiting.append(frame)
        self._count += 1
        self.last = frame

    def flush(self) -> None:
        """Put the frames that wait together, and pass them on."""
        frames, self._waiting = self._waiting, []
        if not frames:
            return
        self._count -= len(frames)
        self.extend(
            frames[0].phase,
            RecordedFrames(
                steps=np.array([frame.step for frame in frames]),
                targets_rad=np.array([frame.target.angles for frame in frames]),
                angles_rad=np.array([frame.angles for frame in frames]),
                root_position=np.array([frame.root_position for frame in frames]),
                root_wxyz=np.array([frame.root_wxyz for frame in frames]),
            ),
        )

    def extend(self, phase: Phase, frames: RecordedFrames) -> None:
        """Record frames of one phase, and pass them on."""
        if not len(frames.steps):
            return
        motion = Motion.from_frames(
            phase=phase,
            time_s=self._start_s + self._step_s * frames.steps.astype(np.float64),
            joint_angles_rad=frames.angles_rad,
            root_position=frames.root_position,
            root_wxyz=frames.root_wxyz,
            joint_error_rad=np.abs(frames.targets_rad - frames.angles_rad),
        )
        self._motions.append(motion)
        self._references.append(frames.targets_rad)
        self._count += len(frames.steps)
        if self._sink is not None:
            self._sink(motion)
