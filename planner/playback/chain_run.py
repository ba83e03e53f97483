"""Chain run: one robot, or the ideal chain, that folds along a trajectory, step by step."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final, Literal

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.rotations import aligned_distances
from foldback.planner.errors import SimulationError
from foldback.planner.motion.motion import Motion, Phase
from foldback.planner.playback.controllers import build_plant
from foldback.planner.playback.frame_recorder import FrameRecorder, RecordedFrame
from foldback.planner.playback.reference_trajectory import ReferenceTrajectory
from foldback.planner.playback.setpoints import Setpoints, Target
from foldback.planner.progress import PROGRESS_PERIOD_S, Cancelled, Progress, Report
from foldback.planner.reasons import Reason
from foldback.planner.reasons import ReasonCode as Code

PlaybackStatus = Literal["folded", "missed", "diverged", "cancelled", "timeout"]
FRAME_TURN_RAD: Final = 0.01
"""Turn of a target, rad, since the last frame at which a simulated playback records the next."""
RESTING_FRAME_TURN_RAD: Final = 0.08
"""The same where the chain rests between turns: frames lie on straight lines."""
FRAME_MOVE_PITCH: Final = 0.2
"""Displacement of a module since the last frame, relative to the mean of all modules, pitches, at
which a simulated playback records the next frame: the ends of a nearly straight chain go far while
its hinges hardly turn. Measured from 0.14 to 0.28: the same clearance (decision 0051)."""
MAX_FRAME_STEPS: Final = 12
"""Maximum number of simulation steps between two recorded frames of a playback; a frame is then
recorded even if the chain hardly moves. Measured from 8 to 17: the same clearance (decision
0051)."""
GOAL_TOLERANCE_PITCH: Final = 0.1
"""Maximum position error at the end of a simulated playback that counts as folded: RMS distance of
the modules from the goal shape, pitches, aligned with it if the chain is free."""


class PlaybackRun:
    """Simulated playback in progress: figures that dense and windowed runs share.

    Attributes:
        steps: Number of steps so far.
        largest_error: Largest joint error so far, rad.
        peak_torque: Largest hinge torque so far, module mass · pitch² / s².
        square_torque: Sum over the steps of the square of the largest hinge torque.
        status, reason: Result; ``cancelled`` until the run has ended.

    Args:
        chain: The chain.
        step_s: Time step, s.
    """

    def __init__(self, chain: Chain, step_s: float) -> None:
        self.chain = chain
        self.step_s = step_s
        self.steps = 0
        self.largest_error = 0.0
        self.peak_torque = 0.0
        self.square_torque = 0.0
        self.status: PlaybackStatus = "cancelled"
        self.reason: Reason | None = None
        self._reported = time.perf_counter(), 0

    def count_step(self, torques: Array) -> None:
        """Count a step with (H,) hinge torques."""
        torque = float(np.abs(torques).max())
        self.peak_torque = max(self.peak_torque, torque)
        self.square_torque += torque * torque
        self.steps += 1

    def check(self, progress: Report, cancelled: Cancelled, fraction: float, message: str) -> bool:
        """Return False if the run is cancelled; report its progress. Most steps do neither."""
        if self.steps % 25:
            return True
        if cancelled():
            return False
        self.report(progress, fraction, message)
        return True

    def report(self, progress: Report, fraction: float, message: str, *, robots: int = 1) -> None:
        """Report the progress of this run and of those of other robots beside it, in time."""
        now, (reported, steps) = time.perf_counter(), self._reported
        if now - reported >= PROGRESS_PERIOD_S:
            progress(
                Progress(
                    stage="play_back",
                    fraction=min(fraction, 0.99),
                    steps=robots * self.steps,
                    steps_per_second=robots * (self.steps - steps) / (now - reported),
                    simulated_s=self.steps * self.step_s,
                    message=message,
                )
            )
            self._reported = now, self.steps

    def lost(self, first: int, errors: Array, fraction: float) -> Reason:
        """Return the reason why a robot has lost a hinge.

        Args:
            first: Number of the first simulated hinge.
            errors: (H,) joint errors, rad.
            fraction: Progress of the playback, 0 to 1.
        """
        worst = int(errors.argmax())
        return Reason.of(
            Code.LOST_TARGET,
            progress=float(fraction),
            joint=self.chain.joint_names[first + worst],
            error_rad=float(errors[worst]),
        )

    def distance_to_goal(self, angles: Array) -> float:
        """Return the RMS distance of the modules from the folded shape, pitches, aligned."""
        poses = self.chain.poses(angles, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
        distances = aligned_distances(poses.positions, self.chain.folded_poses.positions)
        return float(np.sqrt((distances**2).mean()))


class Run(PlaybackRun):
    """Simulation of the ideal chain, or of a chain with the motors of a baseline, step by step.

    Args:
        trajectory: Reference and time scalings.
        sink: Receives the frames as they are made; None if nobody follows.
    """

    def __init__(
        self, trajectory: ReferenceTrajectory, sink: Callable[[Motion], None] | None = None
    ) -> None:
        super().__init__(trajectory.chain, trajectory.step_s)
        self.trajectory = trajectory
        self.finer = trajectory.finer
        self.rest_frames: list[int] = []
        self.plant, self.drive = build_plant(trajectory)
        self.plant.place(*trajectory.begins)
        self.drifts = (
            trajectory.unfolding is not None
            or trajectory.parameters.controller == "computed-torque"
        )
        """True if momentum that integration adds is to be removed: large steps add some."""
        self._recorder = FrameRecorder(trajectory.start_s, self.step_s, sink)
        self._last_centres = np.zeros((0, 3))

    @property
    def frames(self) -> Motion:
        """Recorded frames."""
        return self._recorder.motion

    @property
    def reference_rad(self) -> Array:
        """(F, J) planned angles at the recorded frames, in whole steps."""
        return self._recorder.reference_rad

    def simulate(self, progress: Report, cancelled: Cancelled) -> None:
        """Fold; set ``status`` and ``reason`` to the result."""
        self.status, self.reason = self._simulated(progress, cancelled)
        self._recorder.flush()
        error = self.final_error()
        if self.status == "folded" and error > GOAL_TOLERANCE_PITCH:
            self.status = "missed"
            self.reason = Reason.of(Code.MISSED, error=error)

    def _simulated(
        self, progress: Report, cancelled: Cancelled
    ) -> tuple[PlaybackStatus, Reason | None]:
        plant, recorder = self.plant, self._recorder
        parts: list[tuple[Phase, Setpoints]] = [(p, make()) for p, make in self.trajectory.parts]
        most_steps = self.trajectory.parameters.max_steps
        target = None
        part, first_step = 0, 0
        try:
            while self.steps - first_step < most_steps:
                plant.begin_step()
                angles = plant.angles
                phase, setpoints = parts[part]
                following = setpoints.target(angles, plant.rates)
                if following is None:
                    assert target is not None
                    if part + 1 < len(parts):
                        # The first frame of the next part is here, where this one has ended.
                        part, first_step = part + 1, self.steps
                        recorder.last = None
                        continue
                    self._keep(phase, angles, target)
                    if phase in self.trajectory.resting:
                        self.rest_frames.append(len(recorder) - 1)
                    return "folded", None
                target = following
                errors = np.abs(target.angles - angles)
                self.largest_error = max(self.largest_error, float(errors.max()))
                if self.largest_error > self.trajectory.lost_rad:
                    self._keep(phase, angles, target)
                    return "missed", self.lost(0, errors, target.fraction)
                if self._is_due(angles, target, phase):
                    begins = recorder.last is None
                    self._keep(phase, angles, target)
                    # Of a refold, the straight chain is the end of one part and begins the other.
                    resting = {parts[part][0], parts[max(0, part - 1)][0]} & self.trajectory.resting
                    if target.rests or (begins and resting):
                        self.rest_frames.append(len(recorder) - 1)
                self.drive(target)
                plant.end_step()
                if self.drifts:
                    plant.stop_drifting()
                self.count_step(plant.motor_torques)
                fraction = (part + target.fraction) / len(parts)
                message = "folding" if phase == "playback" else phase
                if not self.check(progress, cancelled, fraction, message):
                    return "cancelled", Reason.of(Code.PLAYBACK_CANCELLED)
        except SimulationError as broken:
            return "diverged", Reason.of(Code.SIMULATION_FAILED, detail=str(broken))
        return "timeout", Reason.of(
            Code.NOT_AT_REST,
            steps=most_steps,
            error=self.final_error(),
            bent=self.bent_wrong(),
            joints=len(self.chain.folded_rad),
        )

    def _is_due(self, angles: Array, target: Target, phase: Phase) -> bool:
        """Return True if a frame is due: the target has moved far enough, or the chain has."""
        last, turn, way = (
            self._recorder.last,
            FRAME_TURN_RAD / self.finer,
            FRAME_MOVE_PITCH / self.finer,
        )
        if last is None or target.rests or self.steps - last.step >= MAX_FRAME_STEPS:
            return True
        turned = float(np.abs(target.angles - last.target.angles).max())
        if phase in self.trajectory.resting:
            return turned >= RESTING_FRAME_TURN_RAD / self.finer
        if turned >= turn:
            return True
        moved = self.plant.centres - self._last_centres
        return bool(np.abs(angles - last.angles).max() >= turn) or bool(
            (moved**2).sum(axis=1).max() >= way * way
        )

    def _keep(self, phase: Phase, angles: Array, target: Target) -> None:
        plant = self.plant
        self._recorder.append(
            RecordedFrame(
                phase=phase,
                step=self.steps,
                target=target,
                angles=angles,
                root_position=plant.root_position,
                root_wxyz=plant.root_wxyz,
            )
        )
        self._last_centres = plant.centres

    def final_error(self) -> float:
        """Return the RMS distance of the modules from the folded shape, pitches, aligned."""
        # A simulation that broke off leaves no numbers; its last sound frame counts.
        angles = self.plant.angles
        if not np.isfinite(angles).all():
            angles = self.frames.joint_angles_rad[-1]
        return self.distance_to_goal(angles)

    def bent_wrong(self) -> int:
        """Return the number of hinges more than 0.1 rad from their folded angle."""
        return int((np.abs(self.plant.angles - self.chain.folded_rad) > 0.1).sum())
