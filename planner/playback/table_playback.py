"""Table playback: a chain is folded on a table, simulated with gravity, contacts and weak motors.

The straight chain lies on the table, its first module clamped there or free, and follows the
record of its explosion back. Gravity, the table and the modules' contacts are MuJoCo's; motors
never exceed their limit. Modules are smaller than a pitch: contacts that the statics assume may be
open, and the chain then yields until they close.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.chain.rotations import aligned_distances
from planner.chain.statics import GRAVITY_M_S2
from planner.errors import InputError, SimulationError
from planner.motion.angle_steps import snapped
from planner.motion.motion import Motion
from planner.parameters.playback import TablePlaybackParameters
from planner.playback.course import TRACKING_LOST_RAD
from planner.playback.playback import Playback
from planner.playback.run import CANCEL_CHECK_STEPS, GOAL_TOLERANCE_PITCH, PlaybackStatus
from planner.playback.table_course import TableCourse
from planner.progress import PROGRESS_PERIOD_S, Cancelled, Progress, Report, never, silent
from planner.simulation.table_body import TableBody

Array = NDArray[np.float64]
TABLE_CHUNK_STEPS: Final = 512
"""Maximum number of simulation steps of a fold on a table whose target angles and torques are
computed at once. Larger values take more memory and a little less time; the targets are the same.
Chosen."""
AT_LIMIT_SHARE: Final = 0.999
"""Fraction of its torque limit above which a motor of a fold on a table is counted as at its limit,
in the reported share of steps with saturated motors. Just below 1 because of rounding; smaller
values report more saturation. Chosen."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TablePlayback:
    """Result of a playback on a table. Lengths in pitches, torques in w·p.

    Attributes:
        status: ``folded``, or the kind of failure.
        reason: Reason in plain English; empty if folded.
        frames: F frames with their joint errors; times are seconds at the chain's pitch. The pose
            of the root is that of the simulation.
        reference_rad: (F, J) planned hinge angles at those frames, rad.
        torques: (F, J) largest magnitude of the motor torques since the frame before.
        position_errors: (F,) RMS over the modules of their position error: relative to a clamped
            first module; for a chain that lies free, which drifts, after the best shift and turn in
            the plane of the table, frame by frame. Heights are never shifted.
        final_error: Last of ``position_errors``.
        aligned_error: RMS distance from the folded shape at the end, after alignment.
        rms_error: RMS over all ``position_errors``.
        largest_error_rad: Largest joint error of all steps.
        torque_limit: Torque limit of the motors.
        largest_torque: Largest torque of all motors and steps.
        share_at_limit: Fraction of the steps in which some motor is at its limit.
        hinge_share_at_limit: Fraction of all motors and steps at the limit.
        friction: μ between modules and table.
        clamped: True if the first module was clamped to the table.
        steps: Number of steps of the simulation.
        duration: Simulated duration, in √(pitch / gravity).
        seconds: Wall time, s.
    """

    status: PlaybackStatus
    reason: str
    frames: Motion
    reference_rad: Array
    torques: Array
    position_errors: Array
    final_error: float
    aligned_error: float
    rms_error: float
    largest_error_rad: float
    torque_limit: float
    largest_torque: float
    share_at_limit: float
    hinge_share_at_limit: float
    friction: float
    clamped: bool
    steps: int
    duration: float
    seconds: float

    def as_playback(self, pitch_m: float) -> Playback:
        """Convert to a general playback; its times are seconds at a pitch, m."""
        unit = GRAVITY_M_S2 / pitch_m  # 1 w·p in module masses · pitch² / s²
        largest = self.torques.max(axis=1, initial=0.0)
        return Playback(
            status=self.status,
            reason=self.reason,
            frames=self.frames,
            reference_rad=self.reference_rad,
            steps=self.steps,
            seconds=self.seconds,
            rms_position_error=self.aligned_error,
            max_angle_error_rad=self.largest_error_rad,
            peak_torque=unit * self.largest_torque,
            rms_torque=unit * float(np.sqrt((largest**2).mean())),
        )


def time_unit_s(chain: Chain) -> float:
    """Return √(pitch / gravity), s."""
    return math.sqrt(chain.pitch_m / GRAVITY_M_S2)


def play_on_table(
    chain: Chain,
    record: Motion,
    *,
    torque_limit_wp: float,
    friction: float = 0.0,
    clamped: bool = True,
    parameters: TablePlaybackParameters | None = None,
    start_s: float = 0.0,
    progress: Report = silent,
    cancelled: Cancelled = never,
) -> TablePlayback:
    """Fold a straight chain on a table.

    Args:
        chain: The chain; folded, it stands on the table with its lowest modules, z up.
        record: Windowed motion of its explosion on the table, folded to straight.
        torque_limit_wp: Largest torque of every motor, w·p.
        friction: μ between modules and table.
        clamped: True if the first module is clamped to the table; else the chain lies free.
        parameters: Parameters of the simulation; the usual ones when None.
        start_s: Time of the first frame, s.
        progress: Receives the progress, a few times a second.
        cancelled: Returns True to stop; called every few steps.

    Raises:
        InputError: ``bad-table`` for numbers out of range, ``no-record`` without two frames.
    """
    if not (torque_limit_wp > 0.0 and math.isfinite(torque_limit_wp)):
        raise InputError(
            "bad-table",
            f"got a limit of {torque_limit_wp:g} w·p, expected more than 0.",
            where="torque_limit_wp",
        )
    if not 0.0 <= friction <= 2.0:
        raise InputError("bad-table", f"got {friction:g}, expected 0 to 2.", where="friction")
    if len(record) < 2:
        raise InputError("no-record", f"got {len(record)} frames, expected two or more.")
    p = TablePlaybackParameters.usual(clamped=clamped) if parameters is None else parameters
    run = _Run(chain, record, p, torque_limit_wp, friction, clamped)
    run.simulate(progress, cancelled)
    return run.result(start_s)


class _Run:
    """State and figures of one run."""

    def __init__(
        self,
        chain: Chain,
        record: Motion,
        p: TablePlaybackParameters,
        limit: float,
        friction: float,
        clamped: bool,
    ) -> None:
        self._begun = time.perf_counter()
        self.chain, self.p, self.limit = chain, p, limit
        self.friction, self.clamped = friction, clamped
        self.body = TableBody(
            chain,
            p,
            height=chain.table_height,
            torque_limit=limit,
            friction=friction,
            clamped=clamped,
        )
        self.course = TableCourse(chain, record, p, self.body, limit)
        self.steps = self.steps_at_limit = self.hinges_at_limit = 0
        self.largest_error = self.largest_torque = 0.0
        self.status: PlaybackStatus = "cancelled"
        self.reason = ""
        self._most = np.zeros(len(chain.folded_rad))
        self._times: list[float] = []
        self._angles: list[Array] = []
        self._targets: list[Array] = []
        self._torques: list[Array] = []
        self._poses: list[tuple[Array, Array]] = []

    def simulate(self, progress: Report, cancelled: Cancelled) -> None:
        """Fold; set ``status`` and ``reason`` to the result."""
        try:
            self.status, self.reason = self._simulated(progress, cancelled)
        except SimulationError as broken:
            self.status, self.reason = "diverged", f"the simulation failed: {broken}"

    def _simulated(self, progress: Report, cancelled: Cancelled) -> tuple[PlaybackStatus, str]:
        course, body = self.course, self.body
        reported = time.perf_counter()
        body.place(course.angles(0, 1)[0])
        for start in range(0, len(course), TABLE_CHUNK_STEPS):
            stop = min(start + TABLE_CHUNK_STEPS, len(course))
            targets, expected = course.angles(start, stop + 1), course.torques(body, start, stop)
            for here, there, torques in zip(targets, targets[1:], expected, strict=False):
                if course.is_kept[self.steps]:
                    self._keep(here)
                self._step(here, there, torques)
                if self.largest_error > TRACKING_LOST_RAD:
                    self._keep(there)
                    return "missed", self._lost(there)
                if self.steps % CANCEL_CHECK_STEPS:
                    continue
                if cancelled():
                    return "cancelled", "the playback was cancelled."
                if (now := time.perf_counter()) - reported >= PROGRESS_PERIOD_S:
                    reported = now
                    progress(
                        Progress(
                            stage="play_back",
                            fraction=min(self.steps / len(course), 0.99),
                            steps=self.steps,
                            steps_per_second=self.steps / (now - self._begun),
                            simulated_s=self.steps * self.p.step,
                            message="folding on the table",
                        )
                    )
        end = course.angles(len(course), len(course) + 1)[0]
        for _ in range(int(self.p.settle / self.p.step)):
            self._step(end, end, np.zeros_like(end))
        self._keep(end)
        return "folded", ""

    def _step(self, here: Array, there: Array, expected: Array) -> None:
        p, body = self.p, self.body
        body.step((there - here) / p.step, here - body.angles, expected)
        torques = np.abs(body.torques)
        np.maximum(self._most, torques, out=self._most)
        at_limit = int((torques > AT_LIMIT_SHARE * self.limit).sum())
        self.hinges_at_limit += at_limit
        self.steps_at_limit += at_limit > 0
        self.largest_torque = max(self.largest_torque, float(torques.max()))
        self.largest_error = max(self.largest_error, float(np.abs(there - body.angles).max()))
        self.steps += 1

    def _keep(self, target: Array) -> None:
        self._times.append(self.steps * self.p.step)
        self._angles.append(self.body.angles)
        self._targets.append(target)
        self._torques.append(self._most.copy())
        self._poses.append(self.body.poses)
        self._most[:] = 0.0

    def _lost(self, target: Array) -> str:
        """Describe which hinge has yielded."""
        off = np.abs(target - self.body.angles)
        worst = int(off.argmax())
        return (
            f"{self.chain.joint_names[worst]} yielded: it is off by {off[worst]:.2g} rad with "
            f"motors of {self.limit:.3g} w·p, {100.0 * self.steps / len(self.course):.0f} % into "
            "the fold."
        )

    def result(self, start_s: float) -> TablePlayback:
        """Return the result of the run."""
        chain = self.chain
        angles, targets = np.array(self._angles), np.array(self._targets)
        positions = np.array([centres for centres, _ in self._poses])
        unit = time_unit_s(chain)
        frames = Motion.from_frames(
            phase="playback",
            time_s=start_s + unit * np.array(self._times),
            joint_angles_rad=angles,
            root_position=positions[:, chain.root],
            root_wxyz=np.array([wxyzs[chain.root] for _, wxyzs in self._poses]),
            joint_error_rad=np.abs(angles - targets),
        )
        if self.clamped:
            frames = frames.clamped(chain)
        meant = frames.planned(chain, frames.with_angles(targets), clamped=self.clamped)
        wanted = meant.poses(chain).positions
        errors = np.sqrt(((positions - wanted) ** 2).sum(axis=2).mean(axis=1))
        aligned = aligned_distances(positions[-1], chain.folded_poses.positions)
        status, reason = self.status, self.reason
        if status == "folded" and errors[-1] > GOAL_TOLERANCE_PITCH:
            status = "missed"
            reason = f"the chain ended {errors[-1]:.2g} pitches (RMS) from its target."
        return TablePlayback(
            status=status,
            reason=reason,
            frames=frames,
            reference_rad=snapped(targets),
            torques=np.array(self._torques),
            position_errors=errors,
            final_error=float(errors[-1]),
            aligned_error=float(np.sqrt((aligned**2).mean())),
            rms_error=float(np.sqrt((errors**2).mean())),
            largest_error_rad=self.largest_error,
            torque_limit=self.limit,
            largest_torque=self.largest_torque,
            share_at_limit=self.steps_at_limit / max(self.steps, 1),
            hinge_share_at_limit=self.hinges_at_limit / max(self.steps * len(angles[0]), 1),
            friction=self.friction,
            clamped=self.clamped,
            steps=self.steps,
            duration=self.steps * self.p.step,
            seconds=time.perf_counter() - self._begun,
        )
