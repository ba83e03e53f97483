"""Window run: one robot that folds a peeled chain along its course, stretch by stretch."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from planner.chain.rotations import aligned_distances
from planner.errors import SimulationError
from planner.motion.motion import Angles, Motion
from planner.playback.course import TRACKING_LOST_RAD
from planner.playback.run import CANCEL_CHECK_STEPS, PlaybackStatus
from planner.playback.setpoints import SETTLE_STEPS
from planner.playback.window_course import Stretch, WindowCourse
from planner.progress import PROGRESS_PERIOD_S, Cancelled, Progress, Report
from planner.simulation.window_robot import WindowRobot

Array = NDArray[np.float64]
Floats = NDArray[np.float32]


class WindowRun:
    """Simulation of one robot that folds a peeled chain.

    Args:
        course: Reference and time law.
        seed: Seed of the robot's model errors.
    """

    def __init__(self, course: WindowCourse, seed: list[int]) -> None:
        self.course = course
        self.steps = 0
        self.largest_error = 0.0
        self.peak_torque = 0.0
        self.square_torque = 0.0
        self.status: PlaybackStatus = "cancelled"
        self.reason = ""
        self._robot = WindowRobot(
            course.chain,
            course.parameters.robot,
            peak_torque=course.peak_torque,
            seed=seed,
            base=(course.reference.anchor_position[0], course.reference.anchor_wxyz[0]),
            geom_size=course.module_size,
            step_s=course.step_s,
        )
        self._angles: list[Floats] = []
        self._poses: list[tuple[Array, Array]] = []

    @property
    def frames(self) -> Motion:
        """Recorded frames; joints outside the window have zero error by construction."""
        reference = self.course.reference[: len(self._angles)]
        angles = np.concatenate(self._angles)
        positions, wxyzs = zip(*self._poses, strict=True)
        return replace(
            reference,
            angles_rad=angles,
            errors_rad=np.abs(angles - reference.angles_rad),
            anchor_position=np.array(positions),
            anchor_wxyz=np.array(wxyzs),
        )

    @property
    def reference_rad(self) -> Angles:
        """(V,) planned angles of the recorded frames."""
        return self.course.reference[: len(self._angles)].angles_rad

    def final_error(self) -> float:
        """Return the RMS distance of the modules from the folded shape, pitches, aligned."""
        chain, frames = self.course.chain, self.frames[-1:]
        poses = chain.poses(frames.angles(chain)[0], np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
        distances = aligned_distances(poses.positions, chain.folded_poses.positions)
        return float(np.sqrt((distances**2).mean()))

    def simulate(self, progress: Report, cancelled: Cancelled) -> None:
        """Fold; set ``status`` and ``reason`` to the result."""
        try:
            self.status, self.reason = self._simulated(progress, cancelled)
        except SimulationError as broken:
            self.status, self.reason = "diverged", f"the simulation failed: {broken}"

    def _simulated(self, progress: Report, cancelled: Cancelled) -> tuple[PlaybackStatus, str]:
        course, robot = self.course, self._robot
        reported, reported_steps = time.perf_counter(), 0
        for number, stretch in enumerate(course.stretches):
            robot.take(stretch.first, stretch.joints)
            targets, torques = course.targets(number), course.torques(number)
            for k in range(stretch.stop - stretch.start):
                self._note(targets.angles[k])
                if course.is_kept[self.steps]:
                    self._keep()
                if self.largest_error > TRACKING_LOST_RAD:
                    return "missed", self._lost(stretch, targets.angles[k])
                self._step(targets.angles[k + 1], targets.rates[k + 1], torques[k])
                if self.steps % CANCEL_CHECK_STEPS:
                    continue
                if cancelled():
                    return "cancelled", "the playback was cancelled."
                now = time.perf_counter()
                if now - reported >= PROGRESS_PERIOD_S:
                    progress(
                        Progress(
                            stage="play_back",
                            fraction=min(self.steps / len(course), 0.99),
                            steps=self.steps,
                            steps_per_second=(self.steps - reported_steps) / (now - reported),
                            simulated_s=self.steps * course.step_s,
                            message="folding",
                        )
                    )
                    reported, reported_steps = now, self.steps
        end = course.targets(len(course.stretches) - 1).angles[-1]
        still = np.zeros_like(end)
        for _ in range(SETTLE_STEPS):
            self._note(end)
            self._step(end, still, still)
        self._note(end)
        self._keep()
        return "folded", ""

    def _step(self, angles: Array, rates: Array, torques: Array) -> None:
        largest = float(np.abs(self._robot.step(angles, rates, torques)).max())
        self.peak_torque = max(self.peak_torque, largest)
        self.square_torque += largest * largest
        self.steps += 1

    def _note(self, targets: Array) -> None:
        """Record the largest joint error so far."""
        error = float(np.abs(targets - self._robot.angles).max())
        self.largest_error = max(self.largest_error, error)

    def _keep(self) -> None:
        self._angles.append(self._robot.angles.astype(np.float32))
        self._poses.append(self._robot.base_pose)

    def _lost(self, stretch: Stretch, targets: Array) -> str:
        """Describe which hinge a robot has lost."""
        off = np.abs(targets - self._robot.angles)
        worst = int(off.argmax())
        name = self.course.chain.joint_names[stretch.hinges(self.course.chain).start + worst]
        return (
            f"a robot lost its target: {name} is off by {off[worst]:.2g} rad, more than its motor "
            f"can correct, {100.0 * self.steps / len(self.course):.0f} % into the fold."
        )
