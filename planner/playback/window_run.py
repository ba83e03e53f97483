"""Window run: one robot that folds a peeled chain along its trajectory, stretch by stretch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Array
from foldback.planner.errors import SimulationError
from foldback.planner.motion.motion import Angles, Motion
from foldback.planner.playback.chain_run import PlaybackRun, PlaybackStatus
from foldback.planner.playback.reference_trajectory import TRACKING_LOST_RAD
from foldback.planner.playback.setpoints import SETTLE_STEPS
from foldback.planner.playback.window_trajectory import WindowTrajectory
from foldback.planner.progress import Cancelled, Report
from foldback.planner.reasons import Reason
from foldback.planner.reasons import ReasonCode as Code
from foldback.planner.simulation.window_robot import WindowRobot

Floats = NDArray[np.float32]


class WindowRun(PlaybackRun):
    """Simulation of one robot that folds a peeled chain.

    Args:
        trajectory: Reference and time scaling.
        seed: Seed of the robot's model errors.
    """

    def __init__(self, trajectory: WindowTrajectory, seed: list[int]) -> None:
        super().__init__(trajectory.chain, trajectory.step_s)
        self.trajectory = trajectory
        self._robot = WindowRobot(
            trajectory.chain,
            trajectory.parameters.robot,
            peak_torque=trajectory.peak_torque,
            seed=seed,
            base=(trajectory.reference.anchor_position[0], trajectory.reference.anchor_wxyz[0]),
            geom_size=trajectory.module_size,
            step_s=trajectory.step_s,
        )
        self._angles: list[Floats] = []
        self._poses: list[tuple[Array, Array]] = []

    @property
    def frames(self) -> Motion:
        """Recorded frames; joints outside the window have zero error by construction."""
        reference = self.trajectory.reference[: len(self._angles)]
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
        return self.trajectory.reference[: len(self._angles)].angles_rad

    def final_error(self) -> float:
        """Return the RMS distance of the modules from the folded shape, pitches, aligned."""
        return self.distance_to_goal(self.frames[-1:].angles(self.chain)[0])

    def simulate(self, progress: Report, cancelled: Cancelled) -> None:
        """Fold; set ``status`` and ``reason`` to the result."""
        try:
            self.status, self.reason = self._simulated(progress, cancelled)
        except SimulationError as broken:
            self.status = "diverged"
            self.reason = Reason.of(Code.SIMULATION_FAILED, detail=str(broken))

    def _simulated(
        self, progress: Report, cancelled: Cancelled
    ) -> tuple[PlaybackStatus, Reason | None]:
        trajectory, robot = self.trajectory, self._robot
        for number, stretch in enumerate(trajectory.stretches):
            robot.take(stretch.first, stretch.joints)
            targets, torques = trajectory.targets(number), trajectory.torques(number)
            for k in range(stretch.stop - stretch.start):
                errors = self._note(targets.angles[k])
                if trajectory.is_kept[self.steps]:
                    self._keep()
                if self.largest_error > TRACKING_LOST_RAD:
                    first = stretch.hinges(self.chain).start
                    return "missed", self.lost(first, errors, self.steps / len(trajectory))
                self._step(targets.angles[k + 1], targets.rates[k + 1], torques[k])
                if not self.check(progress, cancelled, self.steps / len(trajectory), "folding"):
                    return "cancelled", Reason.of(Code.PLAYBACK_CANCELLED)
        end = trajectory.targets(len(trajectory.stretches) - 1).angles[-1]
        still = np.zeros_like(end)
        for _ in range(SETTLE_STEPS):
            self._note(end)
            self._step(end, still, still)
        self._note(end)
        self._keep()
        return "folded", None

    def _step(self, angles: Array, rates: Array, torques: Array) -> None:
        self.count_step(self._robot.step(angles, rates, torques))

    def _note(self, targets: Array) -> Array:
        """Record the largest joint error so far, and return the (H,) present ones, rad."""
        errors = np.abs(targets - self._robot.angles)
        self.largest_error = max(self.largest_error, float(errors.max()))
        return errors

    def _keep(self) -> None:
        self._angles.append(self._robot.angles.astype(np.float32))
        self._poses.append(self._robot.base_pose)
