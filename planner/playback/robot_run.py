"""Robot run: robots that fold along a trajectory, some steps of all of them at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from typing import Final

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.rotations import wxyz_from_matrix
from foldback.planner.motion.motion import Motion, Phase
from foldback.planner.playback.chain_run import (
    FRAME_MOVE_PITCH,
    FRAME_TURN_RAD,
    GOAL_TOLERANCE_PITCH,
    MAX_FRAME_STEPS,
    RESTING_FRAME_TURN_RAD,
    PlaybackRun,
    PlaybackStatus,
)
from foldback.planner.playback.frame_recorder import FrameRecorder, RecordedFrames
from foldback.planner.playback.reference_trajectory import ReferenceTrajectory
from foldback.planner.playback.setpoints import TimedTargets, timed_targets
from foldback.planner.progress import Cancelled, Report
from foldback.planner.reasons import Reason
from foldback.planner.reasons import ReasonCode as Code
from foldback.planner.simulation.mujoco_robot import MujocoRobot, Substeps
from foldback.planner.simulation.robot import FollowedSteps, RobotErrors, RobotTeam

STEPS_AT_ONCE: Final = 32
"""Number of steps that all robots make in one call. Progress is reported, and a playback can be
cancelled, between two calls; each takes about 0.3 ms besides its steps."""


class FrameSchedule:
    """Steps at which all robots record frames: their targets alone decide.

    Attributes:
        rest_frames: Frames at which the chain rests.

    Args:
        trajectory: The trajectory.
    """

    def __init__(self, trajectory: ReferenceTrajectory) -> None:
        self.rest_frames: list[int] = []
        self._trajectory = trajectory
        self._phase: Phase | None = None
        self._last = np.zeros(0)
        self._gone_rad = 0.0
        self._waited = 0
        self._count = 0

    def due(self, phase: Phase, targets: TimedTargets) -> Ints:
        """Return the numbers of the coming steps before which frames are recorded."""
        resting = self._trajectory.resting
        steps = list[int]()
        for k, angles in enumerate(targets.angles):
            begins = phase != self._phase
            if not (begins or self._is_due(phase, angles, targets, k)):
                self._waited += 1
                continue
            # Of a refold, the straight chain is the end of one part and begins the other.
            if targets.rests[k] or (begins and {phase, self._phase or phase} & resting):
                self.rest_frames.append(self._count)
            self._phase, self._last, self._gone_rad = phase, angles, float(targets.gone_rad[k])
            self._waited = 1
            self._count += 1
            steps.append(k)
        return np.array(steps, dtype=np.int64)

    def end(self) -> None:
        """Count the last frame, behind all steps."""
        if self._phase in self._trajectory.resting:
            self.rest_frames.append(self._count)

    def _is_due(self, phase: Phase, angles: Array, targets: TimedTargets, k: int) -> bool:
        finer = self._trajectory.finer
        if targets.rests[k] or self._waited >= MAX_FRAME_STEPS:
            return True
        turned = float(np.abs(angles - self._last).max())
        if phase in self._trajectory.resting:
            return turned >= RESTING_FRAME_TURN_RAD / finer
        distance = abs(float(targets.gone_rad[k]) - self._gone_rad)
        way = FRAME_MOVE_PITCH / finer * self._trajectory.parameters.distance_weight
        return turned >= FRAME_TURN_RAD / finer or distance >= way


class RobotRun(PlaybackRun):
    """Playback of one robot.

    Args:
        trajectory: Reference and time scalings.
        sink: Receives the frames as they are made; None if nobody follows.
    """

    def __init__(
        self, trajectory: ReferenceTrajectory, sink: Callable[[Motion], None] | None = None
    ) -> None:
        super().__init__(trajectory.chain, trajectory.step_s)
        self.rest_frames: list[int] = []
        self.has_ended = False
        """True if the robot is lost or its simulation has failed."""
        self._lost_rad = trajectory.lost_rad
        self._recorder = FrameRecorder(trajectory.start_s, self.step_s, sink)
        self._angles = trajectory.begins[0]

    @property
    def frames(self) -> Motion:
        """Recorded frames."""
        return self._recorder.motion

    @property
    def reference_rad(self) -> Array:
        """(F, J) planned angles at the recorded frames, in whole steps."""
        return self._recorder.reference_rad

    def final_error(self) -> float:
        """Return the RMS distance of the modules from the folded shape, pitches, aligned."""
        return self.distance_to_goal(self._angles)

    def take(
        self, phase: Phase, targets: TimedTargets, due: Ints, followed: FollowedSteps, number: int
    ) -> None:
        """Take the steps of this robot towards some targets.

        Args:
            phase: Phase of the playback.
            targets: Targets of S steps.
            due: Steps before which frames are recorded.
            followed: Steps of some robots.
            number: Number of this one among them.
        """
        made, broken = int(followed.made[number]), followed.broken.get(number)
        compared = min(len(targets), made + 1)  # a step that failed began in a sound state
        angles = followed.states.q[number]
        errors = np.abs(targets.angles[:compared] - angles[:compared])
        worst = errors.max(axis=1, initial=0.0)
        lost = np.flatnonzero(worst > self._lost_rad)
        if len(lost):
            compared, made = int(lost[0]) + 1, int(lost[0])
            self._end("missed", self.lost(0, errors[made], float(targets.fractions[made])))
            due = np.append(due[due < made], made)
        elif broken is not None:
            self._end("diverged", Reason.of(Code.SIMULATION_FAILED, detail=str(broken)))
        self.largest_error = max(self.largest_error, float(worst[:compared].max(initial=0.0)))
        self._keep(phase, targets.angles, due[due < compared], followed, number)
        torques = np.abs(followed.states.torques[number, :made]).max(axis=1, initial=0.0)
        self.peak_torque = max(self.peak_torque, float(torques.max(initial=0.0)))
        self.square_torque = float(np.cumsum([self.square_torque, *(torques * torques)])[-1])
        self.steps += made
        self._angles = angles[made].copy()

    def finish(
        self, phase: Phase, targets: TimedTargets, followed: FollowedSteps, number: int
    ) -> None:
        """Record the last frame, after the last of some steps, and set the result."""
        self.steps -= len(targets)
        held = np.concatenate([targets.angles, targets.angles[-1:]])
        self._keep(phase, held, np.array([len(targets)]), followed, number)
        self.steps += len(targets)
        error = self.final_error()
        self.status, self.reason = "folded", None
        if error > GOAL_TOLERANCE_PITCH:
            self.status, self.reason = "missed", Reason.of(Code.MISSED, error=error)

    def cancel(self) -> None:
        """Set the result of a playback that is cancelled."""
        self._end("cancelled", Reason.of(Code.PLAYBACK_CANCELLED))

    def _end(self, status: PlaybackStatus, reason: Reason) -> None:
        self.status, self.reason, self.has_ended = status, reason, True

    def _keep(
        self, phase: Phase, targets_rad: Array, at: Ints, followed: FollowedSteps, number: int
    ) -> None:
        """Record the frames before some of the steps."""
        states = followed.states
        frames = RecordedFrames(
            steps=self.steps + at,
            targets_rad=targets_rad[at],
            angles_rad=states.q[number, at],
            root_position=states.position[number, at],
            root_wxyz=wxyz_from_matrix(states.rotation[number, at]),
        )
        self._recorder.extend(phase, frames)


def fold_with_robots(
    trajectory: ReferenceTrajectory,
    seeds: Sequence[list[int]],
    sink: Callable[[Motion], None] | None,
    progress: Report,
    cancelled: Cancelled,
) -> list[RobotRun]:
    """Fold with robots along a trajectory, and return their runs.

    Args:
        trajectory: Reference and time scalings; of a robot in MuJoCo if ``by_mujoco`` says so.
        seeds: Seeds of the robots' model errors; one of them in MuJoCo.
        sink: Receives the frames of the first one as they are made; None if nobody follows.
        progress: Receives the progress of all together, a few times a second.
        cancelled: Returns True to stop; called every few steps.
    """
    plant = _Plant(trajectory, seeds)
    runs = [RobotRun(trajectory, None if k else sink) for k in range(len(seeds))]
    schedule = FrameSchedule(trajectory)
    last: tuple[Phase, TimedTargets, FollowedSteps] | None = None
    for fraction, phase, targets, substeps in _parts(trajectory):
        due = schedule.due(phase, targets)
        followed = plant.follow(targets, substeps)
        last = phase, targets, followed
        for number, run in enumerate(runs):
            if not run.has_ended:
                run.take(phase, targets, due, followed, number)
                if run.has_ended:
                    plant.end(number)
        active = [run for run in runs if not run.has_ended]
        if not active:
            break
        if cancelled():
            for run in active:
                run.cancel()
            break
        message = "folding" if phase == "playback" else phase
        active[0].report(progress, fraction, message, robots=len(seeds))
    schedule.end()
    for number, run in enumerate(runs):
        if last is not None and not run.has_ended:
            run.finish(*last, number)
        frames = len(run.frames)
        run.rest_frames = [frame for frame in schedule.rest_frames if frame < frames]
    return runs


class _Plant:
    """Robots of a trajectory, by our engine, or the one of them that MuJoCo itself simulates."""

    def __init__(self, trajectory: ReferenceTrajectory, seeds: Sequence[list[int]]) -> None:
        chain, peak_torque = trajectory.chain, trajectory.peak_torque
        kind, step_s = trajectory.parameters.robot, trajectory.step_s
        if trajectory.by_mujoco:
            (seed,) = seeds
            errors = RobotErrors(chain, kind, peak_torque=peak_torque, seed=seed)
            self._robots = MujocoRobot(
                chain, errors, geom_size=trajectory.module_size, step_s=step_s
            )
        else:
            self._robots = RobotTeam(
                chain,
                kind,
                peak_torque=peak_torque,
                seeds=seeds,
                geom_size=trajectory.module_size,
                step_s=step_s,
            )
        self._robots.place(*trajectory.begins)

    def follow(self, targets: TimedTargets, substeps: list[Substeps]) -> FollowedSteps:
        """Make the steps towards some targets."""
        if isinstance(self._robots, MujocoRobot):
            return self._robots.follow(substeps)
        return self._robots.follow(targets.servo_targets)

    def end(self, number: int) -> None:
        """Let a robot make no more steps."""
        if isinstance(self._robots, RobotTeam):
            self._robots.end(number)


def _parts(
    trajectory: ReferenceTrajectory,
) -> Iterator[tuple[float, Phase, TimedTargets, list[Substeps]]]:
    """Yield the steps of a trajectory, some at a time.

    Yields:
        The progress after these steps, 0 to 1, their phase, their targets, and their parts for a
        robot in MuJoCo; none for others.
    """
    count = len(trajectory.curves)
    for number, (phase, reference, scaling) in enumerate(trajectory.curves):
        divided = iter(trajectory.substeps[number] if trajectory.by_mujoco else ())
        torques = trajectory.torques[number]
        for targets in timed_targets(reference, scaling, torques, at_once=STEPS_AT_ONCE):
            substeps = list(islice(divided, len(targets)))
            if trajectory.by_mujoco:  # the end is held in steps that are not divided
                held = Substeps.still(targets.angles[-1], targets.step_s)
                substeps += [held] * (len(targets) - len(substeps))
            yield (number + float(targets.fractions[-1])) / count, phase, targets, substeps
