"""Reference trajectory: the curves of a playback, each with its time scaling."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from functools import partial
from typing import Final

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.clearance.sweep import sweep
from foldback.planner.errors import InputError
from foldback.planner.motion.motion import Phase
from foldback.planner.motion.record import Record
from foldback.planner.parameters.playback import PlaybackParameters
from foldback.planner.playback.kinematic_playback import root_folded
from foldback.planner.playback.reference_curve import Reference, clear_reference, resting_reference
from foldback.planner.playback.setpoints import (
    SETTLE_STEPS,
    Backwards,
    DirectSetpoints,
    Setpoints,
    Snapshots,
    SnapshotSetpoints,
    TimedSetpoints,
    timed_torques,
)
from foldback.planner.playback.substeps import divided_steps
from foldback.planner.playback.time_scaling import (
    MIN_PLAYBACK_STEPS,
    TimeScaling,
    hinge_bounded_scaling,
    resting_scaling,
    torque_bounded_resting_scaling,
    torque_bounded_scaling,
)
from foldback.planner.playback.unfolding import Unfolding
from foldback.planner.simulation.mujoco_robot import Substeps

STRAIGHT_TORQUE_RATIO: Final = 0.02
"""Ratio of the torques near straight to those elsewhere, for each level of patience. A straight
chain is a soft rod, which swings long after a sudden stop:
docs/decisions/0034-calm-motion.md."""
TRACKING_LOST_RAD: Final = 0.5
"""Joint error (target angle − simulated angle), rad, above which the playback of a simulated robot
ends as failed, because motors at their torque limit would not catch up."""
LAW_SAMPLES_PER_RAD: Final = 180
"""Number of points at which hinge torques are computed to find the speed along a playback's curve,
for each radian of its length (turns of the fastest hinge, or weighted displacements if larger).
Measured from 126 to 252: the same clearance (decision 0051)."""


class ReferenceTrajectory:
    """Reference and time scalings of a playback, computed once for all robots."""

    def __init__(
        self,
        chain: Chain,
        record: Record | None,
        parameters: PlaybackParameters,
        module_size: float,
        start_s: float,
        finer: int,
        unfolding: Unfolding | None,
        patience: int = 0,
    ) -> None:
        self.chain = chain
        self.finer = finer
        self.patience = patience
        self.parameters = parameters
        self.module_size = module_size
        self.start_s = start_s
        self.unfolding = unfolding
        self.by_mujoco = False
        """True if MuJoCo itself simulates the robots."""
        self.curves: list[tuple[Phase, Reference, TimeScaling]] = []
        """Curves in the order of the phases, each with its time scaling; none without a curve."""
        self.torques: list[Array] = []
        """(S + 1, J) torques along each curve that a robot without model errors needs."""
        self.substeps: list[list[Substeps]] = []
        """Steps along each curve, divided for robots in MuJoCo."""
        self.peak_torque = 0.0
        """Largest torque that a robot without model errors needs; 0 if it is not computed."""
        self.resting: frozenset[Phase] = frozenset()
        """Phases in which the chain rests between turns."""
        self.parts = self._all_parts(record, unfolding)
        folds_robots = parameters.controller == "robot"
        self.robots = parameters.robot.robots if folds_robots else 1
        self.lost_rad = TRACKING_LOST_RAD if folds_robots else np.inf
        self.folds_robots = folds_robots
        """True if robots with model errors fold."""
        zero = np.zeros_like(chain.folded_rad)
        if unfolding is not None:
            self.begins = (unfolding.chain.folded_rad, *root_folded(unfolding.chain))
        elif record is None:
            self.begins = (zero, *root_folded(chain))
        else:
            last = record.frames[-1:]
            self.begins = (zero, last.root_position[0], last.root_wxyz[0])

    @property
    def step_s(self) -> float:
        """Time step, s: a refined plan is simulated in as many more steps as it has frames."""
        return self.parameters.step_s / self.finer

    def for_mujoco(self) -> tuple[ReferenceTrajectory, int]:
        """Return this trajectory for robots in MuJoCo, and the number of MuJoCo's steps."""
        robot = self.parameters.robot
        limit = robot.motor_limit * self.peak_torque
        damping = limit / robot.servo_give * robot.damping_s
        twin = copy(self)
        twin.by_mujoco = True
        twin.substeps = [
            divided_steps(reference, scaling, self.chain.module, limit=limit, damping=damping)
            for _, reference, scaling in self.curves
        ]
        parts = sum(len(step.rates) for steps in twin.substeps for step in steps)
        return twin, parts + SETTLE_STEPS * len(self.curves)

    def _all_parts(
        self, record: Record | None, unfolding: Unfolding | None
    ) -> list[tuple[Phase, Callable[[], Setpoints]]]:
        """Return the phases of the playback in order; their setpoints are made anew for a run."""
        p = self.parameters
        if p.controller == "direct":
            folded = self.chain.folded_rad
            return [("playback", lambda: DirectSetpoints(folded, p.direct_steps, p.step_s))]
        if record is None:
            raise InputError(
                "no-record", f"the controller {p.controller!r} needs a record of an explosion."
            )
        angles = record.snapshots_rad
        snapshots = (record.frames.joint_angles_rad if angles is None else angles)[::-1]
        if p.controller == "paper":
            folding: list[tuple[Phase, Callable[[], Setpoints]]] = [
                ("playback", lambda: self._snapshots(snapshots))
            ]
            if unfolding is not None:
                backwards = Backwards(unfolding.time_s, unfolding.folding_rad, p.step_s)
                folding.insert(0, ("unfolding", lambda: self._snapshots(backwards)))
            return folding
        if p.controller not in ("robot", "computed-torque"):
            raise InputError(
                "unknown-controller",
                f"got the controller {p.controller!r}, expected robot, computed-torque, paper or "
                "direct.",
            )
        rests = (
            None if record.rest_frames is None else len(snapshots) - 1 - record.rest_frames[::-1]
        )
        references = [self._reference(self.chain, snapshots, rests)]
        if unfolding is not None:
            rests = np.array(unfolding.rest_frames, np.int64) if unfolding.rest_frames else None
            references.append(self._reference(unfolding.chain, unfolding.folding_rad, rests))
        phases: tuple[Phase, ...] = ("playback", "unfolding")
        self.resting = frozenset(
            phase
            for phase, reference in zip(phases, references, strict=False)
            if reference.rests is not None
        )
        scalings = self._clear_scalings(references)
        self.curves = [("playback", references[0], scalings[0])]
        if unfolding is not None:
            self.curves.insert(0, ("unfolding", references[1], scalings[1].backwards()))
        if p.controller == "robot":
            self.torques = [
                timed_torques(reference, scaling, self.chain.module)
                for _, reference, scaling in self.curves
            ]
            self.peak_torque = max(float(np.abs(torques).max()) for torques in self.torques)
        return [
            (phase, partial(TimedSetpoints, reference, scaling))
            for phase, reference, scaling in self.curves
        ]

    def _snapshots(self, snapshots: Snapshots) -> SnapshotSetpoints:
        p = self.parameters
        return SnapshotSetpoints(
            snapshots, threshold_rad2=p.threshold, steps_per_snapshot=p.steps_per_snapshot
        )

    def _reference(self, chain: Chain, snapshots: Array, rests: Ints | None) -> Reference:
        """Return a curve through configurations from straight on: smooth, or with rests."""
        p = self.parameters
        if rests is not None:
            return resting_reference(snapshots[rests])
        return clear_reference(
            chain,
            snapshots,
            spacing_rad=p.spacing_rad,
            distance_weight=p.distance_weight,
            module_size=self.module_size,
        )

    def _clear_scalings(self, references: list[Reference]) -> list[TimeScaling]:
        """Return the time scalings along the curves, refined while lines between frames touch.

        A plan joins its frames by straight lines. So it is swept before it is played back.
        """
        while True:
            scalings = [self._scaling(reference) for reference in references]
            if self.finer >= 4 or all(
                sweep(
                    self.chain, reference.spline(scaling.u), module_size=self.module_size, share=0.0
                ).clearance
                > 0.0
                for reference, scaling in zip(references, scalings, strict=True)
                if reference.rests is None  # a straight line is the same between any frames
            ):
                return scalings
            self.finer *= 2

    def _scaling(self, reference: Reference) -> TimeScaling:
        p = self.parameters
        if reference.rests is not None:
            seconds = p.steps_per_rad * p.step_s * reference.length_rad
            if p.paced_by == "speed":
                parts = seconds * np.diff(reference.rests)
                return resting_scaling(reference.rests, parts, step_s=self.step_s)
            return torque_bounded_resting_scaling(
                reference, self.chain.module, seconds=seconds, step_s=self.step_s
            )
        steps = max(MIN_PLAYBACK_STEPS, int(self.finer * p.steps_per_rad * reference.length_rad))
        samples = max(
            100,
            min(
                int(LAW_SAMPLES_PER_RAD * reference.length_rad),
                2**23 // len(self.chain.folded_rad),  # 250 MB
            ),
        )
        if p.paced_by == "speed":
            return hinge_bounded_scaling(
                reference,
                steps=2 * steps,  # in the same time, the chain's ends would go faster
                step_s=self.step_s,
                samples=samples,
            )
        return torque_bounded_scaling(
            reference,
            self.chain.module,
            steps=steps,
            step_s=self.step_s,
            samples=samples,
            straight_torque=STRAIGHT_TORQUE_RATIO**self.patience,
        )
